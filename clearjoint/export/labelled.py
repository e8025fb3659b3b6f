"""Datasets by the CF conventions: units and descriptions on variables, versions and settings on the
whole."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..fields.types import ArrayLike
from .provenance import Notes, versions

if TYPE_CHECKING:
    import xarray as xr

COMPONENT = "component"
COMPONENTS = ("x", "y", "z")


class Labelled(NamedTuple):
    """An array with the names of its dimensions, its unit, ``None`` where there is none or it is
    unknown, and what it is."""

    dims: tuple[str, ...]
    values: ArrayLike
    unit: str | None = None
    description: str = ""
    attributes: Mapping[str, object] = {}


def labelled_dataset(
    title: str,
    variables: Mapping[str, Labelled],
    coordinates: Mapping[str, Labelled],
    notes: Notes = (),
) -> "xr.Dataset":
    """A dataset of labelled arrays.

    **Arguments:** `title`: what it is; `notes`: settings and numbers for a reader.
    """
    import xarray as xr

    parts = [{name: _variable(one) for name, one in d.items()} for d in (variables, coordinates)]
    source = {name.removeprefix("version of "): text for name, text in versions().items()}
    whole = {
        "Conventions": "CF-1.11",
        "title": title,
        "source": ", ".join(f"{name} {text}" for name, text in source.items()),
    }
    return xr.Dataset(*parts, attrs={**whole, **dict(notes)})


def texts(labels: ArrayLike) -> np.ndarray:
    """Labels as an array of texts, also where there are none."""
    return np.array(np.asarray(labels).tolist(), dtype=str)


def _variable(one: Labelled) -> tuple[tuple[str, ...], np.ndarray, dict[str, object]]:
    told = {"units": one.unit, "long_name": one.description or None, **one.attributes}
    attributes = {name: value for name, value in told.items() if value is not None}
    return one.dims, np.asarray(one.values), attributes
