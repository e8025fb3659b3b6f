"""Worker processes of Dask."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


@contextmanager
def dask_client(folder: Path) -> Iterator[Any]:
    """A client of two worker processes, each with a nanny that starts another one when it dies."""
    distributed = pytest.importorskip(
        "distributed", reason="Dask is not installed: pip install 'clearjoint[cluster]'"
    )
    cluster = distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        local_directory=str(folder),
    )
    with cluster, distributed.Client(cluster) as client:
        yield client
