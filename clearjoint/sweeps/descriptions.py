"""Description of a sweep as texts: settings that a store compares, and notes for readers."""

from collections.abc import Callable, Mapping

import jax
from jaxtyping import PyTree

from ..export.provenance import describe, described, versions
from ..model.scene import Scene
from ..native import is_native
from ..parametrisation.paths import parameters
from ..simulation.step.settings import Settings
from .axes import Axis, Lanes
from .outputs import Output


def identifying_settings(settings: Settings, start_time: float) -> dict[str, str]:
    """Return, as texts by name, the settings that a store compares.

    A sweep with other settings is another sweep: its lanes would have other numbers.
    """
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


def notes_for_readers(
    settings: Settings,
    end_time: float | Callable[[Scene], float],
    outputs: Mapping[str, Output],
    axes: Mapping[str, Axis],
    lanes: Lanes,
) -> dict[str, str]:
    """Return, as texts by name, the arguments of a sweep and the numbers that all lanes share.

    A store does not compare these notes: the traced programs and the lanes' numbers identify the
    sweep (see `clearjoint.sweeps.store.identity`).
    """
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
        "structure": describe(jax.tree.map(lambda _: 0, lanes.scene)),
        **_constant_numbers(lanes.scene, lanes.varied, "scene"),
        **_constant_numbers(lanes.state, states, "state"),
    }


def _constant_numbers(tree: PyTree, varied: PyTree[bool], name: str) -> dict[str, str]:
    """Return, as texts by name, the numbers of a scene or state that all lanes share.

    **Arguments:** `varied`: PyTree like `tree`, true where lanes differ; `name`: prefix of the
    names.
    """
    varies = {key: any(jax.tree.leaves(flags)) for key, (flags, _) in parameters(varied).items()}
    # netCDF allows no quotes in names: bodies['rod'].mass becomes bodies.rod.mass.
    return {
        f"{name}." + key.replace("['", ".").replace("']", ""): describe(value)
        for key, (value, _) in parameters(tree).items()
        if not varies[key]
    }
