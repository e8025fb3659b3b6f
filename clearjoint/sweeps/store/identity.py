"""By what a store knows the numbers of a sweep: digests of programs and of the lanes' numbers."""

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
"""Lanes put into rows of bytes at a time."""


class Identity(NamedTuple):
    """What makes the numbers of a sweep.

    - `programs`: digests of what is computed, as those of `clearjoint.sweeps.store.program`.
    - `lanes`: (n,) digests of the numbers that each lane starts from, under `program.RUN`; and
      under an output's name of those that it has for itself.
    """

    programs: Mapping[str, str]
    lanes: Mapping[str, np.ndarray]


def run_digests(lanes: Lanes, tasks: Task) -> Int[np.ndarray, " n"]:
    """(n,) of each lane's scene, initial state, end and first step; where no scene can have the
    values, of what is said of them."""
    pairs = zip(_leaves(lanes.scene), _leaves(lanes.scenes), strict=True)
    count = len(tasks.end_time)
    scenes = [
        np.broadcast_to(base, (count, *np.shape(base))) if own is None else own
        for base, own in pairs
        if eqx.is_array_like(base)
    ]
    states = jax.tree.leaves(lanes.states)
    digests = row_digests([*scenes, *states, tasks.end_time, tasks.first_step])
    for lane, message in lanes.bad.items():
        digests[lane] = _number(message.encode())
    return digests


def row_digests(columns: Iterable[ArrayLike]) -> Int[np.ndarray, " n"]:
    """(n,) int64, one for the n-th rows of arrays (n, ...)."""
    arrays = [np.asarray(column) for column in columns]
    count = len(arrays[0])
    digests = np.empty(count, np.int64)
    for first in range(0, count, _BLOCK):
        block = slice(first, min(first + _BLOCK, count))
        rows = [np.ascontiguousarray(a[block]).reshape(block.stop - first, -1) for a in arrays]
        table = np.concatenate([row.view(np.uint8) for row in rows], axis=1)
        digests[block] = [_number(row.tobytes()) for row in table]
    return digests


def places(stored: Int[np.ndarray, " s"], wanted: Int[np.ndarray, " n"]) -> Int[np.ndarray, " s"]:
    """For each stored lane the number of the wanted one with its digest, each once; -1 for none."""
    left: defaultdict[int, deque[int]] = defaultdict(deque)
    for lane, digest in enumerate(wanted.tolist()):
        left[digest].append(lane)
    return np.array(
        [left[digest].popleft() if left[digest] else -1 for digest in stored.tolist()], dtype=int
    )


def _leaves(tree: PyTree) -> list[PyTree]:
    """The leaves; where the tree has nothing, ``None``."""
    return jax.tree.leaves(tree, is_leaf=lambda node: node is None)


def _number(content: bytes) -> int:
    return int.from_bytes(hashlib.blake2b(content, digest_size=8).digest(), "big", signed=True)
