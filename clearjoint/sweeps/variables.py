"""Names, shapes and units of the results of a sweep, from its outputs."""

from collections.abc import Mapping

import numpy as np

from ..fields.checks import require
from ..model.scene import Scene
from ..result_codes import result_numbers
from ..simulation.reductions.base import AbstractReduction
from ..simulation.results.impact_table import IMPACT_UNITS
from ..simulation.results.state_tables import LABELS, STATE_PARTS, contact_label
from ..simulation.run.sections import Section
from .layout import RESULT, Coordinate, Variable
from .outputs import AnySaved, ImpactTable, Output, StatesOfLanes
from .work import CONTACT, variable_name


def variables_of(
    scene: Scene, outputs: Mapping[str, Output]
) -> tuple[dict[str, Variable], tuple[Coordinate, ...]]:
    """Return the variables of a sweep by name, and the labels of their dimensions.

    **Raises:** `ValueError` for an output whose variables have names that are already used.
    """
    variables = _always(scene)
    coordinates = [
        Coordinate("body", np.array(list(scene.bodies), dtype=str)),
        *(Coordinate(name, np.array(labels)) for name, labels in LABELS.items()),
    ]
    for name, output in outputs.items():
        if isinstance(output, AbstractReduction):
            further = _reduced(name, output)
        elif isinstance(output, ImpactTable):
            further = _tabled(scene, name, output)
            labels = [contact_label(*contact) for contact in output.contacts(scene)]
            coordinates.append(Coordinate(variable_name(name, CONTACT), np.array(labels)))
        elif isinstance(output, StatesOfLanes):
            further = _states(scene, name, output)
            coordinates.append(Coordinate(variable_name(name, "time"), output.times, "s"))
        else:
            further = _recorded(scene, name, output)
        twice = sorted(set(variables) & set(further))
        expected = "an output whose results have unused names"
        require(not twice, f"outputs[{name!r}]", twice, expected, "rename the output")
        variables |= further
    return variables, tuple(coordinates)


def _always(scene: Scene) -> dict[str, Variable]:
    codes = result_numbers()
    flags = {"flag_values": list(codes.values()), "flag_meanings": " ".join(codes)}
    variables = {
        RESULT: Variable(dtype="int8", description="result code of the run", attrs=flags),
        "time_reached": Variable(unit="s", description="time at which the run ended"),
        "attempts": Variable(dtype="int64", description="steps tried"),
        "accepted": Variable(dtype="int64", description="steps accepted"),
    }
    for part, (dim, unit) in STATE_PARTS.items():
        shape = (len(scene.bodies), len(LABELS[dim]))
        text = f"{part} of the bodies at the end"
        variables[f"final_{part}"] = Variable(("body", dim), shape, unit=unit, description=text)
    return variables


def _states(scene: Scene, name: str, output: StatesOfLanes) -> dict[str, Variable]:
    variables = {}
    for part, (dim, unit) in STATE_PARTS.items():
        dims = variable_name(name, "time"), "body", dim
        shape = len(output.times), len(scene.bodies), len(LABELS[dim])
        text = f"{part} of the bodies"
        variables[variable_name(name, part)] = Variable(dims, shape, unit=unit, description=text)
    return variables


def _reduced(name: str, output: AbstractReduction) -> dict[str, Variable]:
    kind = type(output).__name__
    return {
        variable_name(name, key): Variable(unit=unit, description=f"{kind}, {key}" if key else kind)
        for key, unit in output.units().items()
    }


def _tabled(scene: Scene, name: str, output: ImpactTable) -> dict[str, Variable]:
    dims = variable_name(name, CONTACT), variable_name(name, "number")
    shape = len(output.contacts(scene)), output.count
    counted = Variable(dims[:1], shape[:1], "int64", description="impacts recorded")
    columns = {
        variable_name(name, key): Variable(dims, shape, unit=unit)
        for key, unit in IMPACT_UNITS.items()
    }
    return {variable_name(name, "count"): counted, **columns}


def _recorded(scene: Scene, name: str, output: AnySaved | Section) -> dict[str, Variable]:
    dim, variables = f"{name}_number", {}
    if isinstance(output, Section):
        length = output.count
        variables[f"{name}_count"] = Variable(dtype="int64", description="crossings recorded")
    else:
        length = len(output.at(scene))
    for key, unit in [("time", "s"), *((key, unit) for key, (_, unit) in output.channels.items())]:
        variables[variable_name(name, key)] = Variable((dim,), (length,), unit=unit)
    return variables
