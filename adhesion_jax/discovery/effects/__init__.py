"""The catalogue. A new effect is one file here and one line in EFFECTS."""

from collections.abc import Mapping

from adhesion_jax.discovery.effects.axle_position import AxlePosition
from adhesion_jax.discovery.effects.base import Columns as Columns
from adhesion_jax.discovery.effects.base import Effect as Effect
from adhesion_jax.discovery.effects.cleaning import Cleaning
from adhesion_jax.discovery.effects.contact_heating import ContactHeating
from adhesion_jax.discovery.effects.covariate import Covariate as Covariate
from adhesion_jax.discovery.effects.curve import CurveOfTrack
from adhesion_jax.discovery.effects.delay import Delay
from adhesion_jax.discovery.effects.drift import Drift
from adhesion_jax.discovery.effects.falling_friction import FallingFriction
from adhesion_jax.discovery.effects.humidity import Humidity
from adhesion_jax.discovery.effects.hysteresis import Hysteresis
from adhesion_jax.discovery.effects.inertia import Inertia
from adhesion_jax.discovery.effects.interaction import Interaction as Interaction
from adhesion_jax.discovery.effects.lag import Lag
from adhesion_jax.discovery.effects.lateral_creep import LateralCreep
from adhesion_jax.discovery.effects.load_peak import LoadPeak
from adhesion_jax.discovery.effects.load_slope import LoadSlope
from adhesion_jax.discovery.effects.load_transfer import LoadTransfer
from adhesion_jax.discovery.effects.mode_asymmetry import ModeAsymmetry
from adhesion_jax.discovery.effects.patch import Patch
from adhesion_jax.discovery.effects.periodic import Periodic as Periodic
from adhesion_jax.discovery.effects.product import Product as Product
from adhesion_jax.discovery.effects.rail_joint import RailJoint
from adhesion_jax.discovery.effects.relaxation import Relaxation
from adhesion_jax.discovery.effects.sanding import Sanding
from adhesion_jax.discovery.effects.shape import ShapeTerm as ShapeTerm
from adhesion_jax.discovery.effects.slip_bias import SlipBias
from adhesion_jax.discovery.effects.slip_noise import SlipNoise
from adhesion_jax.discovery.effects.slip_speed import SlipSpeed
from adhesion_jax.discovery.effects.speed import Speed
from adhesion_jax.discovery.effects.spline import Spline as Spline
from adhesion_jax.discovery.effects.surface import Surface as Surface
from adhesion_jax.discovery.effects.temperature import Temperature
from adhesion_jax.discovery.effects.threshold import Threshold as Threshold
from adhesion_jax.discovery.effects.torque_offset import TorqueOffset
from adhesion_jax.discovery.effects.wheel_order import WheelOrder

#: The physical causes by their names.
EFFECTS: Mapping[str, type[Effect]] = {
    "speed": Speed,
    "slip_speed": SlipSpeed,
    "falling_friction": FallingFriction,
    "load_peak": LoadPeak,
    "load_slope": LoadSlope,
    "humidity": Humidity,
    "temperature": Temperature,
    "contact_heating": ContactHeating,
    "patch": Patch,
    "cleaning": Cleaning,
    "sanding": Sanding,
    "axle_position": AxlePosition,
    "relaxation": Relaxation,
    "delay": Delay,
    "lag": Lag,
    "hysteresis": Hysteresis,
    "curve": CurveOfTrack,
    "lateral_creep": LateralCreep,
    "load_transfer": LoadTransfer,
    "mode_asymmetry": ModeAsymmetry,
    "slip_bias": SlipBias,
    "torque_offset": TorqueOffset,
    "inertia": Inertia,
    "wheel_order": WheelOrder,
    "rail_joint": RailJoint,
    "drift": Drift,
    "slip_noise": SlipNoise,
}
