"""Classes of the results that simulations, fits and other functions of the package return."""

from .identification.fit import Fit as Fit
from .identification.levenberg_marquardt import Ending as Ending
from .identification.levenberg_marquardt import Iteration as Iteration
from .identification.minimise import Minimum as Minimum
from .identification.posterior.result import Posterior as Posterior
from .identification.screening.screening import Screened as Screened
from .information.analysis import Identifiability as Identifiability
from .information.horizon import FitHorizon as FitHorizon
from .model.clearance_joints.lubricated import CarriedJournal as CarriedJournal
from .scene_files.robots import JointLimits as JointLimits
from .scene_files.robots import LinkPose as LinkPose
from .simulation.results.impact_table import Impacts as Impacts
from .simulation.results.nonsmooth_solution import ContactTotals as ContactTotals
from .simulation.results.nonsmooth_solution import NonsmoothSolution as NonsmoothSolution
from .simulation.results.observe import MotionMode as MotionMode
from .simulation.results.observe import Observation as Observation
from .simulation.results.solution import Crossings as Crossings
from .simulation.results.solution import Solution as Solution
from .simulation.results.solution import Trajectory as Trajectory
from .simulation.run.sensitivities import Sensitivities as Sensitivities
from .simulation.run.settle import Settled as Settled
from .simulation.run.wall_impact import FreeImpact as FreeImpact
from .sweeps.largest import LargestFeasible as LargestFeasible
