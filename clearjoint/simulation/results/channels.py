"""Channels: named quantities, each with the text of its unit."""

from collections.abc import Mapping

from ...fields.checks import require, require_array_names
from ...model.scene import Scene
from ...quantities.base import Quantity, check_quantity

Channels = Mapping[str, tuple[Quantity, str]]
"""Pairs of a quantity and the text of its unit, by name of the channel."""
PASS_CHANNELS = 'pass for example {"x": (Position("slider", "x"), "m")}'


def check_channels(channels: Channels) -> None:
    """Check that channels are pairs of a quantity and a unit, and that their names are valid.

    A name must be usable as the name of an array, and differ from "time" and "count".

    **Raises:** `ValueError` otherwise, and for an empty mapping.
    """
    require_array_names("channels", channels, PASS_CHANNELS)
    fine = bool(channels) and all(
        isinstance(pair, tuple)
        and len(pair) == 2
        and callable(pair[0])
        and isinstance(pair[1], str)
        for pair in channels.values()
    )
    require(
        fine,
        "channels",
        channels,
        "a (quantity, unit) pair by name",
        PASS_CHANNELS,
    )
    taken = sorted({"time", "count"} & set(channels))
    require(not taken, "channels", taken, "of names that the output does not use", "rename them")


def check_quantities(channels: Channels, scene: Scene) -> None:
    """Check that a scene has the elements that the quantities of channels name.

    **Raises:** `ValueError` that names the channel.
    """
    for name, (quantity, _) in channels.items():
        check_quantity(f"channel {name!r}", quantity, scene)
