"""Settings of `simulate` by family: a solver, with or without landing, from coarse to fine."""

from dataclasses import dataclass, replace

import diffrax

import clearjoint as cj
from studies.speed_accuracy.evaluations import LANDING
from studies.speed_accuracy.steppers import RungeKutta4, SemiImplicitEuler

TOLERANCES = tuple(10.0**-k for k in range(3, 12))
IMPLICIT_TOLERANCES = TOLERANCES[:3]
IMPLICIT_STEPS = 60_000
"""Limit of attempts of an implicit run; each takes a tenth of a millisecond."""
STEPS = (1e-4, 5e-5, 2e-5, 1e-5, 5e-6, 2e-6, 1e-6)
"""Fixed steps, s."""
EXPLICIT = (
    diffrax.Heun(),
    diffrax.Bosh3(),
    diffrax.Tsit5(),
    diffrax.Dopri5(),
    diffrax.Dopri8(),
)
IMPLICIT = (diffrax.Kvaerno3(), diffrax.Kvaerno5())


@dataclass(frozen=True)
class Setting:
    """Settings of `simulate`; `fineness` is the tolerance or the step as text."""

    solver: str
    lands: bool
    fineness: str
    settings: cj.Settings

    @property
    def family(self) -> str:
        """Name of the solver, and whether it lands."""
        return f"{self.solver}, {'landing' if self.lands else 'not landing'}"

    def __str__(self) -> str:
        return f"{self.family}, {self.fineness}"


def adaptive(solver: diffrax.AbstractSolver, rtol: float, lands: bool = True) -> Setting:
    """Return settings with adaptive steps; implicit methods need a looser absolute tolerance."""
    implicit = isinstance(solver, diffrax.AbstractImplicitSolver)
    settings = cj.Settings(
        solver=solver,
        rtol=rtol,
        atol=rtol * (1e-3 if implicit else 1e-5),
        landing_tolerance=LANDING if lands else None,
    )
    if implicit:
        settings = replace(settings, max_steps=IMPLICIT_STEPS)
    return Setting(type(solver).__name__, lands, f"rtol {rtol:.0e}", settings)


def fixed(solver: diffrax.AbstractSolver, step: float) -> Setting:
    """Return settings with fixed steps, s, which do not land."""
    settings = cj.Settings(
        solver=solver,
        controller=diffrax.ConstantStepSize(),
        first_step=step,
        landing_tolerance=None,
    )
    name = f"{type(solver).__name__}, fixed steps"
    return Setting(name, False, f"{step:.0e} s", settings)


def preset(name: str) -> Setting:
    """Return a preset of clearjoint, or the default of `simulate`."""
    return Setting(name, True, "preset", getattr(cj.presets, name))


def grid() -> list[Setting]:
    """Return all settings of the diagram."""
    found = [
        adaptive(solver, rtol, lands)
        for solver in EXPLICIT
        for lands in (True, False)
        for rtol in TOLERANCES
    ]
    found += [
        adaptive(solver, rtol, lands)
        for solver in IMPLICIT
        for lands in (True, False)
        for rtol in IMPLICIT_TOLERANCES
    ]
    return found + [
        fixed(solver, step) for solver in (RungeKutta4(), SemiImplicitEuler()) for step in STEPS
    ]


def quick_grid() -> list[Setting]:
    """Return the settings of a quick study."""
    return [adaptive(diffrax.Bosh3(), rtol) for rtol in TOLERANCES[:3]]
