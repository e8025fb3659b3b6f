"""Scenes under other names, and results compared by the roles that the names stand for.

JAX sorts the keys of dictionaries. A result must not depend on whether names happen to be in
alphabetical order, so the same call is made with names in this order and with random ones.
"""

import random
import re
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import equinox as eqx
import jax
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

import clearjoint as cj
from clearjoint import RESULTS
from tests.support import symmetry_transformations as symmetries

PLAIN = "ground", "x", "y", "z"
"""Names that are not chosen by the user."""


class Names(dict[str, str]):
    """Names by role, made when a role is first asked for: in alphabetical order, or, with a seed,
    random ones, which differ from any other word. They are arguments of cached functions."""

    def __init__(self, seed: int | None = None):
        super().__init__()
        self._seed, self._random = seed, random.Random(seed)

    def __missing__(self, role: str) -> str:
        if role in PLAIN:
            return role
        letters = "".join(self._random.choices("bcdfghjklmnpqrstvwxzBCDFGHJKLMNPQRSTVWXZ", k=6))
        self[role] = f"n{len(self):03d}n" if self._seed is None else letters
        return self[role]

    def __hash__(self) -> int:  # pyright: ignore[reportIncompatibleVariableOverride]
        return id(self)

    def __eq__(self, other: object) -> bool:
        return self is other

    def sort_otherwise(self) -> bool:
        """Whether the names, in the order of their making, are not in alphabetical order."""
        return [*self.values()] != sorted(self.values())


def renamed(mechanism: tuple[cj.Scene, cj.State], names: Names) -> tuple[cj.Scene, cj.State]:
    """A scene and its state with other names of all bodies, joints and forces. The scene keeps its
    order; the state, whose order has no meaning, has the bodies in the reverse one."""
    scene, state = mechanism
    bodies = {name: names[name] for name in (*scene.bodies, "ground")}
    other = symmetries.renamed(scene, bodies)
    joints = {names[name]: joint for name, joint in other.joints.items()}
    forces = {names[name]: force for name, force in other.forces.items()}
    start = cj.State(
        {names[name]: body for name, body in reversed(state.bodies.items())},
        {names[joint]: dict(speeds) for joint, speeds in state.entry_speeds.items()},
    )
    return cj.Scene(other.bodies, joints, forces, scene.gravity), start


def by_role(value: Any, names: Names) -> Any:
    """The same value in dictionaries, lists, texts and arrays, with roles in place of names.

    Objects become dictionaries of their fields, functions are left out.
    """
    roles = {name: f"<{role}>" for role, name in names.items()}
    pattern = re.compile("|".join(map(re.escape, roles)) or "$^")

    def text(one: str) -> str:
        # The width of a column of a table depends on the lengths of names.
        return re.sub(r"\s+|-{2,}", " ", pattern.sub(lambda m: roles[m.group()], one)).strip()

    def visit(node: Any) -> Any:
        if isinstance(node, str):
            return text(node)
        if node is None or isinstance(node, bool | int | float):
            return node
        if isinstance(node, RESULTS):
            return RESULTS[node]
        if isinstance(node, Enum):
            return node.name
        if isinstance(node, xr.DataArray):
            return visit(node.to_dataset(name="values"))
        if isinstance(node, xr.Dataset):
            return {text(str(name)): labelled(node[name]) for name in node.variables}
        if isinstance(node, Figure):
            return [lines(axes) for axes in node.axes]
        if isinstance(node, np.ndarray | np.generic | jax.Array):
            array = np.asarray(node)
            return visit(array.tolist()) if array.dtype.kind in "OUS" else array
        if isinstance(node, Mapping):
            return {text(key) if isinstance(key, str) else key: visit(v) for key, v in node.items()}
        if is_dataclass(node) or isinstance(node, eqx.Module):
            return {f.name: visit(getattr(node, f.name)) for f in fields(node)}  # pyright: ignore
        if isinstance(node, tuple | list):
            return [visit(part) for part in node]
        return None

    def labelled(array: xr.DataArray) -> Any:
        """The values along dimensions whose texts are sorted by role."""
        for dim in array.dims:
            if dim in array.coords and array[dim].dtype.kind in "OU":
                labels = [text(str(label)) for label in array[dim].values]
                array = array.isel({dim: np.argsort(labels)})
        values = visit(array.values)
        # The row of a table of labels itself.
        return sorted(values) if array.dims and isinstance(values, list) else values

    def lines(axes: Any) -> dict[str, Any]:
        drawn = {}
        for k, line in enumerate(axes.get_lines()):
            label = line.get_label()
            drawn[f"line {k}" if label.startswith("_") else text(label)] = line.get_xydata()
        ticks = [label.get_text() for label in (*axes.get_xticklabels(), *axes.get_yticklabels())]
        return {
            "lines": drawn,
            "title": text(axes.get_title()),
            "labels": [text(axes.get_xlabel()), text(axes.get_ylabel())],
            "names": sorted(text(tick) for tick in ticks if "<" in text(tick)),
            "images": [np.asarray(image.get_array()) for image in axes.get_images()],
        }

    return visit(value)


def differences(one: Any, other: Any, rtol: float, where: str = "") -> Iterator[str]:
    """Lines that say where two values from `by_role` differ.

    Numbers of an array may differ by `rtol` times the largest magnitude in the array.
    """
    if isinstance(one, dict) and isinstance(other, dict):
        if one.keys() != other.keys():
            yield f"{where}: {sorted(map(str, one.keys() ^ other.keys()))} in one only"
        for key in one.keys() & other.keys():
            yield from differences(one[key], other[key], rtol, f"{where}.{key}")
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            yield f"{where}: {len(one)} and {len(other)} entries"
        for k, pair in enumerate(zip(one, other, strict=False)):
            yield from differences(*pair, rtol, f"{where}[{k}]")
    elif isinstance(one, np.ndarray | float | int) and isinstance(other, np.ndarray | float | int):
        a, b = np.asarray(one, float), np.asarray(other, float)
        if a.shape != b.shape:
            yield f"{where}: shapes {a.shape} and {b.shape}"
            return
        finite = a[np.isfinite(a)]
        size = np.abs(finite).max(initial=0.0)
        if not np.allclose(a, b, rtol=0.0, atol=rtol * size, equal_nan=True):
            yield f"{where}: {a.ravel()[:6]} and {b.ravel()[:6]}"
    elif one != other:
        yield f"{where}: {one!r} and {other!r}"
