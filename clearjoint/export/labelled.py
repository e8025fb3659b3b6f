"""Datasets of xarray that follow the CF conventions. Their arrays have units and descriptions, and
their attributes are the settings of the run and the versions of the programs."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..fields.types import ArrayLike
from .provenance import Notes, versions

if TYPE_CHECKING:
    import xarray as xr

COMPONENT = "component"
"""Name of the dimension along the components of a vector."""
COMPONENTS = ("x", "y", "z")
"""Labels of the components of a vector."""


class Labelled(NamedTuple):
    """An array with its labels for a dataset.

    - `dims`: names of the dimensions.
    - `values`: the array.
    - `unit`: unit as text; ``None`` if unknown.
    - `description`: text for the attribute "long_name".
    - `attributes`: further attributes by name.
    """

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
    """Return a dataset of labelled arrays, with the versions of the programs as an attribute.

    **Arguments:** `title`: attribute "title"; `variables`, `coordinates`: arrays by name; `notes`:
    further attributes, such as the settings of the run.
    """
    # Importing xarray takes long, so it is imported only when it is needed.
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
    """Return labels, such as names of bodies, as an array of texts with the same shape.

    Without labels it is an empty array of texts, where `np.asarray` would make one of floats.
    """
    return np.array(np.asarray(labels).tolist(), dtype=str)


def _variable(one: Labelled) -> tuple[tuple[str, ...], np.ndarray, dict[str, object]]:
    given = {"units": one.unit, "long_name": one.description or None, **one.attributes}
    attributes = {name: value for name, value in given.items() if value is not None}
    return one.dims, np.asarray(one.values), attributes
