"""What is measured, how well, and which of it is an angle.

One kind of sensor a file: `components` and `linear`, `range_bearing`, `joint_pixels`, encoders that round or
floor, and `with_bias`, which lets any of them err by a constant.
"""

from .biased import BiasedSensor, with_bias
from .encoders import Encoder, flooring_encoder, rounding_encoder
from .landmarks import RangeBearing, range_bearing
from .linear_sensor import LinearSensor, components, linear
from .pixels import JointPixels, joint_pixels
from .protocol import Sensor

__all__ = [
    "BiasedSensor",
    "Encoder",
    "JointPixels",
    "LinearSensor",
    "RangeBearing",
    "Sensor",
    "components",
    "flooring_encoder",
    "joint_pixels",
    "linear",
    "range_bearing",
    "rounding_encoder",
    "with_bias",
]
