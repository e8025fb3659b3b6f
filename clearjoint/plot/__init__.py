"""Figures of simulated mechanisms with clearance joints.

Every function draws data that is already there (`Observation`, `Trajectory`, `Impacts`, a `Fit`, or
the data set of a sweep) into given matplotlib axes, or into new ones, and returns them; `fitted`
makes a figure of its own. None simulates, saves or shows anything, but `animate_journal`, which
writes a file. Times are in s, lengths in m and forces in N on the way in; the axes show the units
that suit them. Of a sweep, `against`, `parameter_map`, `bifurcation`, `convergence` and `orbit`
take names and units from the data set.
"""

from . import style as style
from .animation import animate_journal as animate_journal
from .animation import journal_frames as journal_frames
from .cycle import over_angle as over_angle
from .cycle import poincare_map as poincare_map
from .fits import correlations as correlations
from .fits import fitted as fitted
from .forces import contact_and_reaction as contact_and_reaction
from .forces import contact_forces as contact_forces
from .forces import enclosed_energy as enclosed_energy
from .forces import hysteresis as hysteresis
from .information import record_length as record_length
from .journal import XY as XY
from .journal import clearance_circle as clearance_circle
from .journal import eccentricities as eccentricities
from .journal import eccentricity_vectors as eccentricity_vectors
from .journal import journal_orbit as journal_orbit
from .journal import orbit_in_contact as orbit_in_contact
from .lanes import against as against
from .lanes import running_median as running_median
from .maps import parameter_map as parameter_map
from .motion import acceleration as acceleration
from .motion import path as path
from .motion import position as position
from .orbits import orbit as orbit
from .power_laws import convergence as convergence
from .power_laws import power_law_exponent as power_law_exponent
from .predictability import growth as growth
from .predictability import integration_error as integration_error
from .sections import bifurcation as bifurcation
