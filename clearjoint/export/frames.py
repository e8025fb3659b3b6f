"""Data frames of datasets: one row along the first dimension, one column for each number there."""

import itertools
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

IN_FRONT = ("body", "contact", "bristle_contact", "joint", "journal", "reaction", "rigid_contact")
"""Dimensions whose labels stand in front of the variable's name, as "arm" in "arm.position.x"."""


def header(name: str, attributes: dict) -> str:
    """A column's name with the unit that its attributes tell: "pin.penetration [m]"."""
    return f"{name} [{attributes['units']}]" if attributes.get("units") else name


def to_frame(dataset: "xr.Dataset", rows: str | None = None) -> "pd.DataFrame":
    """A data frame with a row for each place along a dimension.

    Variables and coordinates without that dimension are left out. Codes with flags become the texts
    that they mean.

    **Arguments:** `rows`: the dimension; the dataset's first unless given.
    """
    import pandas as pd

    rows = next(iter(map(str, dataset.sizes))) if rows is None else rows
    columns = {}
    beside = [name for name in dataset.coords if name != rows]
    for name in (*beside, *dataset.data_vars):
        array = dataset[name]
        if rows in array.dims:
            columns |= _columns(str(name), array, rows)
    index = dataset[rows]
    named = header(rows, index.attrs)
    return pd.DataFrame(columns, index=pd.Index(index.values, name=named))


def _columns(name: str, array: "xr.DataArray", rows: str) -> dict[str, np.ndarray]:
    """The columns of a variable, one for each combination of its other dimensions' labels."""
    others = [str(dim) for dim in array.dims if dim != rows]
    values = array.transpose(rows, *others).values
    told = array.attrs
    if "flag_meanings" in told:
        values, told = _meanings(values, told), {}
    columns = {}
    for place in itertools.product(*(range(array.sizes[dim]) for dim in others)):
        labels = {d: str(array[d].values[k]) for d, k in zip(others, place, strict=True)}
        front = [label for dim, label in labels.items() if dim in IN_FRONT]
        behind = [label for dim, label in labels.items() if dim not in IN_FRONT]
        columns[header(".".join([*front, name, *behind]), told)] = values[(..., *place)]
    return columns


def _meanings(codes: np.ndarray, attributes: dict) -> np.ndarray:
    """The texts that codes stand for."""
    flags = np.atleast_1d(attributes["flag_values"]).tolist()
    texts = dict(zip(flags, attributes["flag_meanings"].split(), strict=True))
    return np.array([texts.get(code, str(code)) for code in codes.ravel()], dtype=object).reshape(
        codes.shape
    )
