"""Description of a sweep before it runs: its variables, settings and notes, from its arguments."""

from collections.abc import Callable, Mapping

import jax
import numpy as np
from jaxtyping import PyTree

from ..export.provenance import describe, described, versions
from ..fields.checks import require
from ..model.scene import Scene
from ..native import is_native
from ..parametrisation.paths import parameters
from ..result_codes import result_numbers
from ..simulation.reductions.base import AbstractReduction
from ..simulation.results.impact_table import IMPACT_UNITS
from ..simulation.results.state_tables import LABELS, STATE_PARTS, contact_label
from ..simulation.run.sections import Section
from ..simulation.step.settings import Settings
from .axes import Axis, Lanes
from .layout import PENDING, RESULT, Coordinate, Variable
from .outputs import ImpactTable, Output, StatesOfLanes
from .work import CONTACT, variable_name


def variables_of(
    scene: Scene, outputs: Mapping[str, Output]
) -> tuple[dict[str, Variable], tuple[Coordinate, ...]]:
    """Return the variables of a sweep by name, and the labels of their dimensions.

    **Arguments:** `scene`: scene of the sweep; `outputs`: requested outputs by name.

    **Returns:** the variables that every sweep has, followed by those of the outputs; and a
    `Coordinate` for each dimension with labels, apart from the axes.

    **Raises:** `ValueError` for an output whose variables have names that are already used.
    """
    # By the CF conventions, these attributes tell the names of the integers of a code.
    codes = result_numbers()
    flags = {
        "flag_values": [PENDING, *codes.values()],
        "flag_meanings": " ".join(["pending", *codes]),
    }
    variables = {
        RESULT: Variable(dtype="int8", description="result code of the run", attrs=flags),
        "time_reached": Variable(unit="s", description="time at which the run ended"),
        "attempts": Variable(dtype="int64", description="steps tried"),
        "accepted": Variable(dtype="int64", description="steps accepted"),
        **_states(scene, "final", "of the bodies at the end"),
    }
    coordinates = [
        Coordinate("body", np.array(list(scene.bodies), dtype=str)),
        *(Coordinate(name, np.array(labels)) for name, labels in LABELS.items()),
    ]
    for name, output in outputs.items():
        # Tables of impacts have a dimension of contacts, and saved states one of times; both are
        # named after the output, since their labels may differ between outputs.
        if isinstance(output, ImpactTable):
            labels = [contact_label(*contact) for contact in output.contacts(scene)]
            coordinates.append(Coordinate(variable_name(name, CONTACT), np.array(labels)))
        elif isinstance(output, StatesOfLanes):
            coordinates.append(Coordinate(variable_name(name, "time"), output.times, "s"))
        further = _variables_of_output(scene, name, output)
        twice = sorted(set(variables) & set(further))
        expected = "an output whose results have unused names"
        require(not twice, f"outputs[{name!r}]", twice, expected, "rename the output")
        variables |= further
    return variables, tuple(coordinates)


def _variables_of_output(scene: Scene, name: str, output: Output) -> dict[str, Variable]:
    """Return the variables of one output by name.

    **Arguments:** `scene`: scene of the sweep; `name`: name of the output.
    """
    if isinstance(output, StatesOfLanes):
        return _states(scene, name, "of the bodies", (variable_name(name, "time"), output.times))
    if isinstance(output, AbstractReduction):
        kind = type(output).__name__
        texts = {key: f"{kind}, {key}" if key else kind for key in output.units()}
        return {
            variable_name(name, key): Variable(unit=unit, description=texts[key])
            for key, unit in output.units().items()
        }
    # All other outputs are tables of impacts, crossings or saved quantities. They have a variable
    # for each column, along the numbers of the rows. Lanes record different numbers of impacts and
    # crossings, which are counted in a further variable.
    counted: dict[str, Variable] = {}
    if isinstance(output, ImpactTable):
        dims = variable_name(name, CONTACT), variable_name(name, "number")
        shape, units = (len(output.contacts(scene)), output.count), IMPACT_UNITS
        counted["count"] = Variable(dims[:1], shape[:1], "int64", description="impacts recorded")
    else:
        dims, units = (variable_name(name, "number"),), {"time": "s"}
        units |= {key: unit for key, (_, unit) in output.channels.items()}
        if isinstance(output, Section):
            shape = (output.count,)
            counted["count"] = Variable(dtype="int64", description="crossings recorded")
        else:
            # Every lane saves at equally many times, which is checked when their tasks are made.
            shape = (len(output.at(scene)),)
    columns = {key: Variable(dims, shape, unit=unit) for key, unit in units.items()}
    return {variable_name(name, key): v for key, v in (counted | columns).items()}


def _states(
    scene: Scene, name: str, description: str, along: tuple[str, np.ndarray] | None = None
) -> dict[str, Variable]:
    """Return variables with the states of all bodies, by name.

    **Arguments:** `name`: output to which the states belong; `description`: end of the variables'
    descriptions; `along`: name of a dimension before that of the bodies, and its labels.
    """
    dims, shape = ((), ()) if along is None else (along[:1], along[1].shape)
    return {
        variable_name(name, part): Variable(
            (*dims, "body", dim),
            (*shape, len(scene.bodies), len(LABELS[dim])),
            unit=unit,
            description=f"{part} {description}",
        )
        for part, (dim, unit) in STATE_PARTS.items()
    }


def identifying_settings(settings: Settings, start_time: float) -> dict[str, str]:
    """Return, as texts by name, the settings that a store compares.

    The numbers of the lanes depend on them, so a sweep with other settings is another sweep. They
    include the start time, the kind of compiled program ("native", or XLA and its backend), and the
    versions of clearjoint, JAX and diffrax. Other settings, such as the solver, are recognised by
    the digests of the traced programs.

    **Arguments:** `settings`: settings of the integration; `start_time`: s, start of all runs.
    """
    names = ("rtol", "atol", "landing_tolerance", "ledger", "max_steps")
    values = {name: getattr(settings, name) for name in names}
    program = "native" if is_native() else f"XLA, {jax.default_backend()}"
    return described({"start_time": start_time, **values, "program": program}) | versions()


def notes_for_readers(
    settings: Settings,
    end_time: float | Callable[[Scene], float],
    outputs: Mapping[str, Output],
    axes: Mapping[str, Axis],
    lanes: Lanes,
) -> dict[str, str]:
    """Return, as texts by name, the arguments of a sweep and the numbers that all lanes share.

    They become attributes of the results, so that readers see how these were computed. A store does
    not compare these notes. It recognises a sweep by the traced programs and the numbers of the
    lanes (see `clearjoint.sweeps.store.program`).

    **Arguments:** `settings`, `end_time`, `outputs`, `axes`: arguments of `sweep`; `lanes`: scenes
    and initial states of the lanes.
    """
    # For each leaf of the state, whether it differs between lanes.
    states = jax.tree.map(lambda rows: bool((rows != rows[0]).any()), lanes.states)
    names = ("solver", "controller", "first_step", "stabilisation", "redundant")
    choices = {
        "end_time": end_time,
        **{name: getattr(settings, name) for name in names},
        # An attribute "coordinates" of a dataset is one that xarray itself writes to files.
        "method: coordinates": settings.coordinates,
        **{f"output {name}": output for name, output in outputs.items()},
    }
    return {
        **described(choices),
        **{f"axis {name}": axis.described() for name, axis in axes.items()},
        # Names and kinds of the scene's elements, with 0 in place of their numbers.
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
