"""A sweep's layout as the metadata of a Zarr store: written before any result, and read back."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from ..fields import require
from .layout import LANE, RESULT, Coordinate, Layout, Variable

_FORMAT = "sweep_format"
_OWN = (
    "sweep_axes",
    "sweep_shape",
    "sweep_zipped",
    "sweep_chunk",
    "sweep_coordinates",
    _FORMAT,
    "coordinates",
)
"""Attributes of the store that are no settings of the sweep."""


def write_layout(path: Path, layout: Layout) -> None:
    """Make a store without results at a path where nothing is."""
    taken = sorted(set(_OWN) & set(layout.settings))
    require(not taken, "settings", taken, "names that the store does not use", "rename them")
    names = [axis.name for axis in layout.axes]
    further = [c.name for c in layout.coordinates]
    shape = list(layout.shape)
    values = (names, shape, layout.zipped, layout.chunk, further, 1, " ".join(names))
    own = dict(zip(_OWN, values, strict=True))
    group = zarr.create_group(path, zarr_format=3, attributes={**layout.settings, **own})
    columns = layout.values()
    for axis in layout.axes:
        _write_labels(group, axis._replace(values=columns[axis.name]), LANE)
    for coordinate in layout.coordinates:
        _write_labels(group, coordinate, coordinate.name)
    for name, variable in layout.variables.items():
        group.create_array(
            name,
            shape=(layout.lanes, *variable.shape),
            chunks=(layout.chunk, *(max(size, 1) for size in variable.shape)),
            dtype=variable.dtype,
            fill_value=variable.fill,
            compressors=None if name == RESULT else "auto",
            dimension_names=(LANE, *variable.dims),
            attributes=variable.attributes,
        )
    with warnings.catch_warnings():
        # Still a draft in format 3; but without it xarray warns whenever the store is opened.
        warnings.filterwarnings("ignore", "Consolidated metadata")
        zarr.consolidate_metadata(group.store)


def read_layout(path: Path) -> Layout:
    """The layout of the store at a path.

    **Raises:** `ValueError` if no sweep's store is there.
    """
    try:
        group = zarr.open_group(path, mode="r", use_consolidated=True)
        attrs: dict[str, Any] = dict(group.attrs)
        if attrs[_FORMAT] != 1:
            raise KeyError(_FORMAT)
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(
            f"Argument `path` must name the store of a sweep, but {path} is none: pass another "
            "path, or delete what is there."
        ) from error
    names, shape, zipped, chunk, further, *_ = (attrs.pop(name) for name in _OWN)
    axes = [_read_labels(group, name) for name in names]
    if not zipped:
        axes = [_along(axis, shape, dim) for dim, axis in enumerate(axes)]
    labels = {*names, *further}
    return Layout(
        tuple(axes),
        chunk,
        {name: _variable(array) for name, array in group.arrays() if name not in labels},
        tuple(_read_labels(group, name) for name in further),
        attrs,
        zipped,
    )


def _write_labels(group: zarr.Group, coordinate: Coordinate, dim: str) -> None:
    name, values, _ = coordinate
    dtype: Any = str if values.dtype.kind == "U" else values.dtype
    attributes: dict[str, Any] = coordinate.attributes
    array = group.create_array(
        name,
        shape=values.shape,
        dtype=dtype,
        dimension_names=(dim,),
        attributes=attributes,
    )
    array[:] = values


def _read_labels(group: zarr.Group, name: str) -> Coordinate:
    array: Any = group[name]
    return Coordinate(name, array[:], array.attrs.get("units", "1"))


def _along(axis: Coordinate, shape: list[int], dim: int) -> Coordinate:
    """An axis' values, from those of all lanes."""
    grid = np.moveaxis(axis.values.reshape(shape), dim, -1)
    return axis._replace(values=grid.reshape(-1, shape[dim])[0])


def _variable(array: zarr.Array) -> Variable:
    attrs: dict[str, Any] = dict(array.attrs)
    unit, description = attrs.pop("units"), attrs.pop("long_name")
    metadata: Any = array.metadata
    return Variable(
        tuple(metadata.dimension_names[1:]),
        array.shape[1:],
        str(array.dtype),
        unit,
        description,
        attrs,
    )
