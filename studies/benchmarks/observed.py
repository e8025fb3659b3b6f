"""What a sweep does not report: the batch that ran it, and its program."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

from clearjoint.batch import Batch
from clearjoint.sweeps.task import Work


@contextmanager
def observed() -> Iterator[list[tuple[Work, Batch]]]:
    """The works of the sweeps that run inside, each with its batch, in a list."""
    seen: list[tuple[Work, Batch]] = []
    run = Work.run

    def seen_run(work: Work, *arguments: Any, **settings: Any) -> Batch:
        seen.append((work, run(work, *arguments, **settings)))
        return seen[-1][1]

    with patch.object(Work, "run", seen_run):
        yield seen
