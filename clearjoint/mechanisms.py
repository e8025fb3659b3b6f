"""Ready mechanisms, each as a scene with its initial state."""

from .fields.readable import without_modules as _without_modules
from .model.mechanisms.andrews_squeezer import andrews_squeezer as andrews_squeezer
from .model.mechanisms.common import STEEL as STEEL
from .model.mechanisms.double_pendulum import double_pendulum as double_pendulum
from .model.mechanisms.four_bar import four_bar as four_bar
from .model.mechanisms.gear_pair import gear_pair as gear_pair
from .model.mechanisms.guided_slider_crank import guided_slider_crank as guided_slider_crank
from .model.mechanisms.iftomm_linkages import bricard as bricard
from .model.mechanisms.iftomm_linkages import double_four_bar as double_four_bar
from .model.mechanisms.quick_return import quick_return as quick_return
from .model.mechanisms.robot_arm import robot_arm as robot_arm
from .model.mechanisms.rotor_in_bearing import rotor_in_bearing as rotor_in_bearing
from .model.mechanisms.slider_crank import CRANK_LENGTH as CRANK_LENGTH
from .model.mechanisms.slider_crank import ROD_LENGTH as ROD_LENGTH
from .model.mechanisms.slider_crank import slider_crank as slider_crank
from .model.mechanisms.spatial_four_bar import spatial_four_bar as spatial_four_bar

__dir__ = _without_modules(globals())
