"""What a sweep does not report: the batch that ran it, and its program."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import patch

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh

from clearjoint.batch import Batch
from clearjoint.pool import Common, Seat, begin
from clearjoint.sweeps.task import Work, extent


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


def one_device() -> Mesh:
    """A mesh of the first device."""
    return Mesh(np.array(jax.devices()[:1]), ("lanes",))


def begun(work: Work) -> tuple[Common, Seat]:
    """What a work's lanes share, and a pool of them before their first steps, on one device."""
    common = jax.tree.map(
        lambda leaf: jnp.asarray(leaf) if isinstance(leaf, np.ndarray) else leaf, work.common
    )
    lanes = np.arange(extent().pool) % len(work)
    tasks = jax.tree.map(lambda leaf: jnp.asarray(leaf[lanes]), work.tasks)
    return common, begin(common, one_device(), tasks)
