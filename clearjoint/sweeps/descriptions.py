"""What a sweep is, in texts: those by which a store tells it from others, and those for readers."""

from collections.abc import Callable, Mapping

import jax

from ..export.provenance import described, versions
from ..model.scene import Scene
from ..native import is_native
from ..simulation.step.settings import Settings
from .axes import Axis, Lanes
from .outputs import Output
from .store.notes import number_notes, structure_note


def decisive(settings: Settings, start_time: float) -> dict[str, str]:
    """Numbers and choices that tell the sweep from others, as a store has them."""
    numbers = {
        "start_time": start_time,
        "rtol": settings.rtol,
        "atol": settings.atol,
        "landing_tolerance": settings.landing_tolerance,
        "ledger": settings.ledger,
        "max_steps": settings.max_steps,
        "program": "native" if is_native() else f"XLA, {jax.default_backend()}",
    }
    return described(numbers) | versions()


def informative(
    settings: Settings,
    end_time: float | Callable[[Scene], float],
    outputs: Mapping[str, Output],
    axes: Mapping[str, Axis],
    lanes: Lanes,
) -> dict[str, str]:
    """What else was asked for, what the lanes have in common, and what makes them differ."""
    states = jax.tree.map(lambda rows: bool((rows != rows[0]).any()), lanes.states)
    choices = {
        "end_time": end_time,
        "solver": settings.solver,
        "controller": settings.controller,
        "first_step": settings.first_step,
        "method: coordinates": settings.coordinates,
        "stabilisation": settings.stabilisation,
        "redundant": settings.redundant,
        **{f"output {name}": output for name, output in outputs.items()},
    }
    return {
        **described(choices),
        **{f"axis {name}": axis.described() for name, axis in axes.items()},
        "structure": structure_note(lanes.scene),
        **number_notes(lanes.scene, lanes.varied, "scene"),
        **number_notes(lanes.state, states, "state"),
    }
