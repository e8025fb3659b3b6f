"""Equations of motion in joint coordinates, without constraints."""

import clearjoint as cj
from clearjoint._dynamics import system as dynamics
from clearjoint._math.vectors import fold_constants
from clearjoint.extend import Formulation, System, unpack
from tests.dynamics.test_joint_coordinates import ABSOLUTE, JOINT


def test_a_tree_solves_no_constraints(monkeypatch):
    """Neither stabilisation nor projection nor multipliers are traced."""
    monkeypatch.setattr(dynamics, "ConstraintEquations", None)
    scene, state = cj.mechanisms.double_pendulum()
    scene, bodies = unpack(fold_constants(scene)), unpack(state.bodies)
    variables, entry_speeds = JOINT.encode(scene, bodies), {"shoulder": {"V": 0.1, "W": 0.1}}
    system = System(scene, Formulation(JOINT, cj.Projection()))
    assert system.dynamics(variables, entry_speeds, 0.0).multipliers == {}
    assert not system.is_constrained(0.0)
    absolute = System(scene, Formulation(ABSOLUTE))
    assert absolute.is_constrained(0.0)
    assert system.project(variables, 0.0) is variables
