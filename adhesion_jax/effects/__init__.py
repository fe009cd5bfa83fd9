"""The catalogue. A new effect is one file here and one line in EFFECTS."""

from collections import ChainMap
from collections.abc import Mapping, MutableMapping
from typing import cast

from adhesion_jax.effects.api import Cause as Cause
from adhesion_jax.effects.api import Columns as Columns
from adhesion_jax.effects.api import Effect as Effect
from adhesion_jax.effects.axle_position import AxlePosition
from adhesion_jax.effects.cleaning import Cleaning
from adhesion_jax.effects.contact_heating import ContactHeating
from adhesion_jax.effects.delay import Delay
from adhesion_jax.effects.drift import Drift
from adhesion_jax.effects.falling_friction import FallingFriction
from adhesion_jax.effects.humidity import Humidity
from adhesion_jax.effects.hysteresis import Hysteresis
from adhesion_jax.effects.inertia import Inertia
from adhesion_jax.effects.interaction import Interaction as Interaction
from adhesion_jax.effects.labels import Labels as Labels
from adhesion_jax.effects.lag import Lag
from adhesion_jax.effects.lateral_creep import LateralCreep
from adhesion_jax.effects.load_peak import LoadPeak
from adhesion_jax.effects.load_slope import LoadSlope
from adhesion_jax.effects.load_transfer import LoadTransfer
from adhesion_jax.effects.mode_asymmetry import ModeAsymmetry
from adhesion_jax.effects.one_column import Covariate as Covariate
from adhesion_jax.effects.one_column import Memory as Memory
from adhesion_jax.effects.one_column import Periodic as Periodic
from adhesion_jax.effects.one_column import Threshold as Threshold
from adhesion_jax.effects.patch import Patch
from adhesion_jax.effects.product import Product as Product
from adhesion_jax.effects.rail_joint import RailJoint
from adhesion_jax.effects.relaxation import Relaxation
from adhesion_jax.effects.sanding import Sanding
from adhesion_jax.effects.shape import ShapeTerm as ShapeTerm
from adhesion_jax.effects.slip_bias import SlipBias
from adhesion_jax.effects.slip_speed import SlipSpeed
from adhesion_jax.effects.speed import Speed
from adhesion_jax.effects.spline import Spline as Spline
from adhesion_jax.effects.surface import Surface as Surface
from adhesion_jax.effects.temperature import Temperature
from adhesion_jax.effects.torque_offset import TorqueOffset
from adhesion_jax.effects.track_curve import CurveOfTrack
from adhesion_jax.effects.wheel_order import WheelOrder

#: The physical causes by their names. One of your own is searched for from when it is put here.
EFFECTS: MutableMapping[str, type[Cause]] = {
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
}

#: Every kind of effect by the name it is saved under; those beyond the causes are forms over any
#: column.
KINDS: Mapping[str, type[Effect]] = ChainMap(
    {
        "covariate": Covariate,
        "spline": Spline,
        "labels": Labels,
        "memory": Memory,
        "threshold": Threshold,
        "product": Product,
        "interaction": Interaction,
        "surface": Surface,
        "periodic": Periodic,
    },
    cast("MutableMapping[str, type[Effect]]", EFFECTS),  # whose names come first
)


def kind_of(effect: Effect) -> str:
    """The name of KINDS that an effect is saved under."""
    return next(name for name, kind in KINDS.items() if kind is type(effect))


def family_of(name: str) -> str:
    """The family of a cause, or of what says the same as one by another name; else the name."""
    if name in EFFECTS:
        return EFFECTS[name].FACTS.family
    return next(
        (cause.FACTS.family for cause in EFFECTS.values() if name in cause.FACTS.same_as), name
    )
