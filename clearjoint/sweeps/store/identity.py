"""Identity of a sweep: digests of its programs and of the numbers of its lanes.

A run is determined by the program and by the numbers from which the run starts. A store therefore
compares digests of both. The store doesn't compare source texts, names or the axes: a sweep over
other axes that reaches the same numbers finds its stored lanes.
"""

import hashlib
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Int, PyTree

from ...fields.types import ArrayLike
from ...simulation.lanes.tasks import Task
from ..axes import Lanes

_BLOCK = 4096
"""Number of lanes whose bytes are in memory at the same time."""


class Identity(NamedTuple):
    """Digests that identify a sweep of n lanes.

    - `programs`: digests of the programs by name; see `clearjoint.sweeps.store.program`.
    - `lanes`: digests (n,) of the numbers from which each lane starts, under the key `program.RUN`;
      and under the name of an output, digests (n,) of the times at which it is saved.
    """

    programs: Mapping[str, str]
    lanes: Mapping[str, np.ndarray]


def run_digests(lanes: Lanes, tasks: Task) -> Int[np.ndarray, " n"]:
    """Return digests (n,) of each lane's scene, initial state, end time and first step.

    Lanes with invalid values are hashed by their error message.
    """
    pairs = zip(_leaves(lanes.scene), _leaves(lanes.scenes), strict=True)
    count = len(tasks.end_time)
    scenes = [
        np.broadcast_to(base, (count, *np.shape(base))) if varied is None else varied
        for base, varied in pairs
        if eqx.is_array_like(base)
    ]
    states = jax.tree.leaves(lanes.states)
    digests = row_digests([*scenes, *states, tasks.end_time, tasks.first_step])
    for lane, message in lanes.bad.items():
        digests[lane] = _number(message.encode())
    return digests


def row_digests(columns: Iterable[ArrayLike]) -> Int[np.ndarray, " n"]:
    """Return the digest of each row, over arrays (n, ...) side by side, as int64 (n,)."""
    arrays = [np.asarray(column) for column in columns]
    count = len(arrays[0])
    digests = np.empty(count, np.int64)
    for first in range(0, count, _BLOCK):
        block = slice(first, min(first + _BLOCK, count))
        rows = [np.ascontiguousarray(a[block]).reshape(block.stop - first, -1) for a in arrays]
        table = np.concatenate([row.view(np.uint8) for row in rows], axis=1)
        digests[block] = [_number(row.tobytes()) for row in table]
    return digests


def matching_lanes(
    stored: Int[np.ndarray, " s"], wanted: Int[np.ndarray, " n"]
) -> Int[np.ndarray, " s"]:
    """Return for each stored digest the number of a wanted lane with the same digest, (s,).

    No lane occurs twice; the number is -1 where no lane is left.
    """
    # Equal digests are usual: an axis may repeat a value.
    unmatched: defaultdict[int, deque[int]] = defaultdict(deque)
    for lane, digest in enumerate(wanted.tolist()):
        unmatched[digest].append(lane)
    return np.array(
        [unmatched[digest].popleft() if unmatched[digest] else -1 for digest in stored.tolist()],
        dtype=int,
    )


def _leaves(tree: PyTree) -> list[PyTree]:
    """Return the leaves of a PyTree, with ``None`` as a leaf."""
    return jax.tree.leaves(tree, is_leaf=lambda node: node is None)


def _number(content: bytes) -> int:
    return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "big", signed=True)
