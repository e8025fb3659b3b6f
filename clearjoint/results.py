"""Classes of the results that simulations, fits and other functions of the package return."""

from ._identification.fit import Fit as Fit
from ._identification.levenberg_marquardt import Ending as Ending
from ._identification.levenberg_marquardt import Iteration as Iteration
from ._identification.minimise import Minimum as Minimum
from ._identification.posterior.result import Posterior as Posterior
from ._identification.screening.screening import Screened as Screened
from ._information.analysis import Identifiability as Identifiability
from ._information.horizon import FitHorizon as FitHorizon
from ._model.clearance_joints.lubricated import CarriedJournal as CarriedJournal
from ._scene_files.robots import JointLimits as JointLimits
from ._scene_files.robots import LinkPose as LinkPose
from ._simulation.results.impact_table import Impacts as Impacts
from ._simulation.results.nonsmooth_solution import ContactTotals as ContactTotals
from ._simulation.results.nonsmooth_solution import NonsmoothSolution as NonsmoothSolution
from ._simulation.results.observe import MotionMode as MotionMode
from ._simulation.results.observe import Observation as Observation
from ._simulation.results.solution import Crossings as Crossings
from ._simulation.results.solution import Solution as Solution
from ._simulation.results.solution import Trajectory as Trajectory
from ._simulation.run.rejections import Rejections as Rejections
from ._simulation.run.sensitivities import Sensitivities as Sensitivities
from ._simulation.run.settle import Settled as Settled
from ._simulation.run.wall_impact import FreeImpact as FreeImpact
from ._simulation.step.step_state import Rejection as Rejection
from ._sweeps.largest import LargestFeasible as LargestFeasible
