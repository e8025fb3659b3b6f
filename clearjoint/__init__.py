"""Differentiable simulation of mechanisms whose revolute joints have clearance.

A `Scene` holds bodies, joints and forces by name, and a `State` the positions and velocities of the
bodies. `simulate` computes one motion, `sweep` computes many and returns selected results,
`sensitivities` computes derivatives of a motion with respect to parameters, and `identify`
estimates parameters from measurements. Contact laws are in `clearjoint.laws`, friction laws in
`clearjoint.frictions`, films in `clearjoint.films`, profiles of bearings in `clearjoint.profiles`,
ready mechanisms in `clearjoint.mechanisms`, measurable quantities in `clearjoint.quantities`,
figures in `clearjoint.plot`, types of results in `clearjoint.results`, and base classes for
elements of your own in `clearjoint.extend`. All numbers are in SI units.

**Glossary**

| term | meaning |
|---|---|
| base | one of the two end circles of a journal, whose contacts are computed; named "V" and "W" |
| bearing, journal | the hole and the pin of a revolute joint with clearance |
| breakpoint | time at which a driver or load is declared to change abruptly; steps end there |
| bristle | elastic deflection of the surfaces in friction laws with sticking; a contact's state |
| clearance | radius of the bearing less that of the journal, m; in other joints, the play |
| constraint row | one scalar equation of a joint, with its Jacobian |
| contact | one pair of surfaces of a clearance joint that may touch, with a label such as "V" |
| dense output | the solution between the ends of a step |
| eccentricity | distance of a base's centre from the bearing's axis, m |
| element | a joint, force or driver of a scene |
| entry speed | penetration rate at the onset of the present contact, m/s; contact laws use it |
| event | an onset or end of a contact, or a breakpoint |
| film | lubricant between journal and bearing |
| fingerprint | digest by which a store recognises the sweep that it holds |
| folded constant | vector component that is exactly 0 or 1 and compiled as such |
| landing | the adjustment of a step so that it ends at an event |
| lane | one run of a sweep, computed in a slot beside other runs |
| memory | numbers that a sampled force, such as a servo, remembers between its instants |
| onset | instant at which a contact's force begins |
| output | named result of a run: a quantity at sample times, a reduction, a section or a table |
| path | function that selects a number: `lambda scene: scene.joints["pin"].clearance` |
| penetration | depth of a contact, m, positive where the surfaces overlap |
| profile | deviation of a bearing's wall or a journal from its circle, around the axis |
| quantity | scalar function of the motion at an instant, as a sensor reads it, such as `Position` |
| reduction | output that is updated at every accepted step, such as a maximum |
| residual | prediction less measurement, over the noise |
| result code | how a run ended, one of `RESULTS` |
| saltation | jump of derivatives across an event |
| section | Poincaré section: quantities at the instants at which another one rises through zero |
| segment | sequence of steps that compiled code takes before it returns to Python |
| slot | position of a lane in a processor's vector |
| step, attempt | an accepted time step; a trial that may be rejected |
| tangent | derivative of a variable by a parameter, integrated with it |
| variables | coordinates, velocities, bristles, memories and work that the solver integrates |

**From a clearance to its force**

1. `_simulation/run/simulate.py`: `simulate` hands the scene to a compiled program, which splits the
   scene's arrays into scalars (`unpack` in `_math/vectors.py`).
2. `_dynamics/system.py`: `System.dynamics`, called in every stage of a step, needs contact forces.
3. `_dynamics/contact_forces.py`: `contact_forces` asks each contact for its gap and its force.
4. `_model/clearance_joints/clearance.py`: `ClearanceJoint.contacts` finds the gap, with
   the penetration: the eccentricity less the clearance.
5. `_model/contact/laws.py`: `contact_normal_force` evaluates the law at that gap. The stiffness
   depends on the clearance too (`RavnStiffness` in `_model/contact/laws.py`).

**Examples** in docstrings assume these lines, and `cj.configure()` after the imports:

>>> import clearjoint as cj
>>> import jax.numpy as jnp
>>> import matplotlib.pyplot as plt
>>> import numpy as np
>>> from clearjoint import extend, plot, testing
>>> spring = cj.SpringDamper("ground", "ball", (0, 0, 0), (0, 0, 0), stiffness=100.0)
>>> scene = cj.Scene({"ball": cj.Body(1.0, (1e-3, 1e-3, 1e-3))}, forces={"spring": spring})
>>> state = cj.State({"ball": cj.body_state((0.1, 0, 0))})  # 0.1 cos(10 t)
>>> stiffness = cj.Parameter(lambda scene: scene.forces["spring"].stiffness, cj.Log())
>>> still = testing.moving((0, 0, 0), (1, 0, 0, 0), (0, 0, 0), (0, 0, 0))
>>> motions = {"ground": still, "arm": still}
>>> times, x = np.linspace(0.01, 0.3, 30), cj.quantities.Position("ball", "x")
"""

from importlib import import_module as _import_module
from types import ModuleType as _ModuleType

# First of all, so that the source files are noted before any other module is read from them.
from ._compilation.package_code import remember_contents as _remember_contents

# isort: split
from . import extend as extend
from . import films as films
from . import frictions as frictions
from . import laws as laws
from . import mechanisms as mechanisms
from . import presets as presets
from . import profiles as profiles
from . import quantities as quantities
from . import results as results
from ._durability.wear import cycles_to_depth as cycles_to_depth
from ._durability.wear import life_derivatives as life_derivatives
from ._durability.wear import open_wear as open_wear
from ._durability.wear import wear as wear
from ._durability.wear import worn as worn
from ._durability.wear_rates import WearRates as WearRates
from ._dynamics.absolute_coordinates import AbsoluteCoordinates as AbsoluteCoordinates
from ._dynamics.assembly import assemble as assemble
from ._dynamics.constraint_report import constraint_report as constraint_report
from ._dynamics.formulation import Baumgarte as Baumgarte
from ._dynamics.formulation import Projection as Projection
from ._dynamics.formulation import Unstabilised as Unstabilised
from ._dynamics.joint_coordinates.coordinates import JointCoordinates as JointCoordinates
from ._fields.cautions import LawRangeWarning as LawRangeWarning
from ._fields.cautions import LeftBearingWarning as LeftBearingWarning
from ._fields.cautions import LooseBodyWarning as LooseBodyWarning
from ._fields.cautions import NotCarriedOverWarning as NotCarriedOverWarning
from ._fields.cautions import PoorFitWarning as PoorFitWarning
from ._fields.cautions import UnusualValueWarning as UnusualValueWarning
from ._fields.objects import without_modules as _without_modules
from ._identification.identify import FitInterrupted as FitInterrupted
from ._identification.identify import identify as identify
from ._identification.identify import identify_many as identify_many
from ._identification.minimise import minimise as minimise
from ._identification.posterior.posterior import posterior as posterior
from ._identification.screening.screening import Screening as Screening
from ._identification.starts import Starts as Starts
from ._information.analysis import Sensor as Sensor
from ._information.analysis import identifiability as identifiability
from ._information.horizon import fit_horizon as fit_horizon
from ._measurements.readers import Channel as Channel
from ._measurements.readers import from_xarray as from_xarray
from ._measurements.readers import function_from_csv as function_from_csv
from ._measurements.readers import read_csv as read_csv
from ._measurements.robot_logs import LogColumn as LogColumn
from ._measurements.robot_logs import RobotLog as RobotLog
from ._measurements.series import Measurements as Measurements
from ._measurements.series import Series as Series
from ._model import densities as densities
from ._model.bodies import GROUND as GROUND
from ._model.bodies import Body as Body
from ._model.bodies import BodyState as BodyState
from ._model.bodies import State as State
from ._model.bodies import body_state as body_state
from ._model.bodies import rotation as rotation
from ._model.clearance_joints.backlash import Backlash as Backlash
from ._model.clearance_joints.ball_in_socket import BallInSocket as BallInSocket
from ._model.clearance_joints.between_walls import PinInSlot as PinInSlot
from ._model.clearance_joints.between_walls import SliderInGuide as SliderInGuide
from ._model.clearance_joints.clearance import ClearanceJoint as ClearanceJoint
from ._model.clearance_joints.clearance import EndPlay as EndPlay
from ._model.clearance_joints.clearance import FixedAxially as FixedAxially
from ._model.clearance_joints.clearance import FreeAxially as FreeAxially
from ._model.clearance_joints.gear_backlash import GearBacklash as GearBacklash
from ._model.clearance_joints.lubricated import LubricatedJoint as LubricatedJoint
from ._model.clearance_joints.lubricated import carried_journal as carried_journal
from ._model.clearance_joints.massless_link import MasslessLink as MasslessLink
from ._model.clearance_joints.stops import BallOnBall as BallOnBall
from ._model.clearance_joints.stops import Stop as Stop
from ._model.drives.drivers import DriveTorque as DriveTorque
from ._model.drives.drivers import Motor as Motor
from ._model.drives.drivers import PrescribedAngle as PrescribedAngle
from ._model.drives.drivers import PrescribedRotation as PrescribedRotation
from ._model.drives.drivers import PrescribedTranslation as PrescribedTranslation
from ._model.drives.functions_of_time import PiecewiseConstant as PiecewiseConstant
from ._model.drives.functions_of_time import PiecewiseLinear as PiecewiseLinear
from ._model.drives.functions_of_time import Polynomial as Polynomial
from ._model.drives.functions_of_time import Spline as Spline
from ._model.drives.servo import Encoder as Encoder
from ._model.drives.servo import Servo as Servo
from ._model.forces import AppliedLoad as AppliedLoad
from ._model.forces import Bushing as Bushing
from ._model.forces import SpringDamper as SpringDamper
from ._model.forces import TorsionalSpring as TorsionalSpring
from ._model.joints.couplings import GearJoint as GearJoint
from ._model.joints.couplings import JointCoupling as JointCoupling
from ._model.joints.ideal import CylindricalJoint as CylindricalJoint
from ._model.joints.ideal import DistanceJoint as DistanceJoint
from ._model.joints.ideal import FixedJoint as FixedJoint
from ._model.joints.ideal import InlineJoint as InlineJoint
from ._model.joints.ideal import LineInPlaneJoint as LineInPlaneJoint
from ._model.joints.ideal import PlanarJoint as PlanarJoint
from ._model.joints.ideal import PointInPlaneJoint as PointInPlaneJoint
from ._model.joints.ideal import PrismaticJoint as PrismaticJoint
from ._model.joints.ideal import RevoluteJoint as RevoluteJoint
from ._model.joints.ideal import ScrewJoint as ScrewJoint
from ._model.joints.ideal import SphericalJoint as SphericalJoint
from ._model.joints.ideal import UniversalJoint as UniversalJoint
from ._model.joints.joint_friction import JointFriction as JointFriction
from ._model.scene import Scene as Scene
from ._parametrisation.parameter import Bounded as Bounded
from ._parametrisation.parameter import Linear as Linear
from ._parametrisation.parameter import Log as Log
from ._parametrisation.parameter import Parameter as Parameter
from ._parametrisation.paths import parameters as parameters
from ._parametrisation.paths import set_value as set_value
from ._result_codes import RESULTS as RESULTS
from ._robot_fits.fit_robot import fit_robot as fit_robot
from ._runtime import XLA_FLAGS as XLA_FLAGS
from ._runtime import configure as configure
from ._scene_files.drive_train import Drive as Drive
from ._scene_files.files import load as load
from ._scene_files.files import save as save
from ._scene_files.mjcf_writer import save_mjcf as save_mjcf
from ._scene_files.mujoco_comparison import compare_with_mujoco as compare_with_mujoco
from ._scene_files.robot import load_robot as load_robot
from ._scene_files.schema import scene_schema as scene_schema
from ._simulation.nonsmooth.simulate import simulate_nonsmooth as simulate_nonsmooth
from ._simulation.reductions.joints import ArchardWear as ArchardWear
from ._simulation.reductions.joints import DissipatedEnergy as DissipatedEnergy
from ._simulation.reductions.joints import ImpactCount as ImpactCount
from ._simulation.reductions.joints import MeanPowerLost as MeanPowerLost
from ._simulation.reductions.quantities import Integral as Integral
from ._simulation.reductions.quantities import Peak as Peak
from ._simulation.reductions.quantities import Quantiles as Quantiles
from ._simulation.reductions.quantities import Statistics as Statistics
from ._simulation.results.impact_table import beyond_law_ranges as beyond_law_ranges
from ._simulation.results.observe import observe as observe
from ._simulation.results.solution import SimulationError as SimulationError
from ._simulation.run.outputs import ImpactTable as ImpactTable
from ._simulation.run.predictor import Predictor as Predictor
from ._simulation.run.predictor import predictor as predictor
from ._simulation.run.rejections import RejectedSteps as RejectedSteps
from ._simulation.run.saving import Saving as Saving
from ._simulation.run.sections import Section as Section
from ._simulation.run.sensitivities import sensitivities as sensitivities
from ._simulation.run.settle import Settling as Settling
from ._simulation.run.settle import settle as settle
from ._simulation.run.simulate import simulate as simulate
from ._simulation.run.terminal import RunInterrupted as RunInterrupted
from ._simulation.run.wall_impact import free_impact as free_impact
from ._simulation.step.settings import Settings as Settings
from ._statistics.derivatives import statistics_derivatives as statistics_derivatives
from ._statistics.ensemble import ensemble as ensemble
from ._statistics.global_sensitivity import sobol_indices as sobol_indices
from ._statistics.uncertain import Uncertain as Uncertain
from ._statistics.uncertain import design as design
from ._sweeps.axes import Axis as Axis
from ._sweeps.executors import ChunkError as ChunkError
from ._sweeps.largest import largest_feasible as largest_feasible
from ._sweeps.store.store import open_sweep as open_sweep
from ._sweeps.sweep import sweep as sweep
from ._views.viewing import View as View
from ._views.viewing import view as view
from .quantities.accelerometer import Accelerometer as Accelerometer
from .quantities.accelerometer import accelerometer as accelerometer


def __getattr__(name: str) -> _ModuleType:
    # These modules are imported on first use, since most programs don't need Matplotlib or checks
    # of user-defined classes.
    if name in ("plot", "testing"):
        return _import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__dir__ = _without_modules(
    globals(),
    *("densities", "extend", "films", "frictions", "laws", "mechanisms"),
    *("plot", "presets", "profiles", "quantities", "results", "testing"),
)
# Last of all, since the objects in all modules that have been imported are recorded.
_remember_contents()
