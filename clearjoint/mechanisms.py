"""Functions that return ready mechanisms, each as a scene with its initial state.

`STEEL` is a contact stiffness for their joints, and `CRANK_LENGTH` and `ROD_LENGTH` are lengths of
`slider_crank`, m.
"""

from ._model.mechanisms.benchmarks import andrews_squeezer as andrews_squeezer
from ._model.mechanisms.benchmarks import bricard as bricard
from ._model.mechanisms.benchmarks import double_four_bar as double_four_bar
from ._model.mechanisms.common import STEEL as STEEL
from ._model.mechanisms.double_pendulum import double_pendulum as double_pendulum
from ._model.mechanisms.four_bars import four_bar as four_bar
from ._model.mechanisms.four_bars import spatial_four_bar as spatial_four_bar
from ._model.mechanisms.gears import cycloid_stage as cycloid_stage
from ._model.mechanisms.gears import gear_pair as gear_pair
from ._model.mechanisms.quick_return import quick_return as quick_return
from ._model.mechanisms.robot_arm import robot_arm as robot_arm
from ._model.mechanisms.rotor_in_bearing import rotor_in_bearing as rotor_in_bearing
from ._model.mechanisms.slider_cranks import CRANK_LENGTH as CRANK_LENGTH
from ._model.mechanisms.slider_cranks import ROD_LENGTH as ROD_LENGTH
from ._model.mechanisms.slider_cranks import guided_slider_crank as guided_slider_crank
from ._model.mechanisms.slider_cranks import slider_crank as slider_crank
