"""Figures of simulated mechanisms with clearance joints.

| of a run | functions |
|---|---|
| path of the journal in the bearing | `journal_orbit`, `orbit_in_contact`, `eccentricities` |
| forces over time | `contact_forces`, `joint_forces`, `contact_and_reaction` |
| motion of a body | `position`, `acceleration`, `path` |
| force over penetration | `hysteresis` |
| times of free flight, impact and lasting contact | `motion_timeline` |
| directions of contact | `contact_rose` |
| energies and the error of their balance | `energy_ledger` |
| any quantity of the motion | `phase_portrait`, `poincare_section`, `spectrum`, `over_angle` |
| report on one page | `report` |

| of a sweep | functions |
|---|---|
| outputs over parameters | `against`, `parameter_map`, `convergence` |
| Poincaré sections over a parameter, or of a run | `bifurcation`, `poincare_section_of_lane` |
| path of the journal and wear of a run | `orbit`, `wear` |
| depth of wear after growing numbers of cycles, from `clearjoint.wear` | `worn_profile` |

| of a fit or its planning | functions |
|---|---|
| measurements and the fitted model | `fitted`, `correlations` |
| torque of a robot's joints over position | `joint_hysteresis` |
| accuracy over the length of a record | `record_length`, `growth`, `integration_error` |

The functions draw existing data into the given matplotlib `axes`, or into new ones, and return the
axes. Only `animate_journal` and `report` write files. Arguments are in SI units; axes have units
with suitable prefixes, lengths in a bearing mm, or µm for a clearance below 0.2 mm. Curves also
differ by line style, and areas by hatching, for print without colours.

These arguments mean the same in all functions:

- `observation`: from `cj.observe`, along ``solution.steps.between()`` or at other instants that
  resolve free flights and impacts.
- `joint` (with contacts), `body`: their names. `base`: "V" or "W", the journal's end circles.
- `clearance`: radial clearance, m. Where it may be left out, it is that of the observed joint.
- `window`: start and end of the drawn time, s; by default all is drawn.
- `dataset`: from `sweep` or `open_sweep`. If the sweep has several axes, select one value of each
  axis that is not drawn: ``dataset.sel(restitution=0.9)``.
- `lane`: data set of one lane, a run of a sweep: ``dataset.isel(clearance=3)``.
- `fit`, `horizon`: from `cj.identify` and `cj.fit_horizon`.
- `section`: the directions drawn to the right and upwards, see `eccentricity_vectors`; but in
  figures of Poincaré sections the name under which the `Section` was passed in `outputs`.
- `quantity`, `unit`: one of `clearjoint.quantities`, or another scalar function of an `Instant`,
  and its SI unit if it does not declare one.
- `trajectory`: the states to take instead of the saved ones, such as `solution.steps`.
- `axis`: name of the swept parameter to draw over; by default the only axis of the sweep. A zipped
  sweep, whose axes vary together, needs a name.

A scale over a sweep is logarithmic if all values are positive and the largest exceeds 12 times the
smallest; for a swept parameter also if its values form a geometric series. Lanes that failed or
have not run yet are crosses at the lower edge.

**Raises:** `ValueError` for unknown names, for a joint that lacks the journal or the contacts to
draw, for a window without drawn times, for a solution without states, for a quantity without a
unit, for an output that is not one number for each drawn value, and for axes that are not polar
where polar ones are needed.

**Examples** in this module's docstrings assume these lines, after those in `clearjoint`'s:

>>> pendulum, hanging = cj.mechanisms.double_pendulum()
>>> save = cj.Saving(np.linspace(0, 0.02, 2001), steps=True, impacts=True)
>>> solution = cj.simulate(pendulum, hanging, 0.02, save=save, progress=False)
>>> observed = cj.observe(pendulum, solution, solution.steps.between())
>>> swing = cj.simulate(scene, state, 0.5, save=cj.Saving(np.linspace(0, 0.5, 101)), progress=False)
>>> values = cj.Axis(lambda scene: scene.forces["spring"].stiffness, [50, 100, 200, 400])
>>> rate = cj.quantities.Velocity("ball", "x")
>>> turns = cj.Section(rate, {"x": (x, "m"), "speed": (rate, "m/s")}, count=3)
>>> outputs = {"turns": turns, "speed": cj.Peak(rate, "m/s")}
>>> found = cj.sweep(scene, state, 2.0, {"stiffness": values}, outputs, progress=False)
>>> data = cj.Measurements({"x": cj.Series(x, times, 0.1 * np.cos(10.0 * times), noise=1e-4)})
>>> unknown, guess = {"stiffness": stiffness}, {"stiffness": 90.0}
>>> fit = cj.identify(scene, state, data, unknown, guess=guess, progress=False)
>>> probe = {"probe": cj.Sensor(x, times, noise=1e-4)}
>>> limits = cj.fit_horizon(scene, state, unknown, probe, uncertainty={"stiffness": np.log(1.5)})
"""

from .._fields.objects import without_modules as _without_modules
from . import style as style
from .animation import animate_journal as animate_journal
from .animation import journal_frames as journal_frames
from .fits import correlations as correlations
from .fits import fitted as fitted
from .fits import growth as growth
from .fits import integration_error as integration_error
from .fits import joint_hysteresis as joint_hysteresis
from .fits import record_length as record_length
from .forces import ContactPhase as ContactPhase
from .forces import contact_and_reaction as contact_and_reaction
from .forces import contact_forces as contact_forces
from .forces import contact_phases as contact_phases
from .forces import enclosed_energy as enclosed_energy
from .forces import hysteresis as hysteresis
from .forces import joint_forces as joint_forces
from .forces import motion_timeline as motion_timeline
from .journal import XY as XY
from .journal import clearance_circle as clearance_circle
from .journal import eccentricities as eccentricities
from .journal import eccentricity_vectors as eccentricity_vectors
from .journal import journal_orbit as journal_orbit
from .journal import orbit as orbit
from .journal import orbit_in_contact as orbit_in_contact
from .motion import acceleration as acceleration
from .motion import over_angle as over_angle
from .motion import path as path
from .motion import position as position
from .polar import contact_rose as contact_rose
from .polar import wear as wear
from .polar import worn_profile as worn_profile
from .report_page import report as report
from .sections import bifurcation as bifurcation
from .sections import poincare_map as poincare_map
from .sections import poincare_section as poincare_section
from .sections import poincare_section_of_lane as poincare_section_of_lane
from .sweeps import against as against
from .sweeps import convergence as convergence
from .sweeps import parameter_map as parameter_map
from .sweeps import power_law_exponent as power_law_exponent
from .sweeps import running_median as running_median
from .time_series import amplitude_spectrum as amplitude_spectrum
from .time_series import energy_ledger as energy_ledger
from .time_series import phase_portrait as phase_portrait
from .time_series import rate_series as rate_series
from .time_series import series as series
from .time_series import spectrum as spectrum
from .time_series import spectrum_of as spectrum_of

__dir__ = _without_modules(globals(), "style")
