"""The catalogue. A new effect is one class here, in a file of its like, and a line in EFFECTS."""

from collections import ChainMap
from collections.abc import Mapping, MutableMapping
from typing import cast

from adhesion_jax.effects.api import Cause as Cause
from adhesion_jax.effects.api import Columns as Columns
from adhesion_jax.effects.api import Effect as Effect
from adhesion_jax.effects.contact import Cleaning, Hysteresis, Relaxation, Sanding
from adhesion_jax.effects.labels import Labels as Labels
from adhesion_jax.effects.load import LoadPeak, LoadSlope, LoadTransfer
from adhesion_jax.effects.one_column import Constant as Constant
from adhesion_jax.effects.one_column import Covariate as Covariate
from adhesion_jax.effects.one_column import Memory as Memory
from adhesion_jax.effects.one_column import Periodic as Periodic
from adhesion_jax.effects.one_column import Spline as Spline
from adhesion_jax.effects.one_column import Threshold as Threshold
from adhesion_jax.effects.shape import ShapeTerm as ShapeTerm
from adhesion_jax.effects.signals import Delay, Inertia, Lag, SlipBias, TorqueOffset
from adhesion_jax.effects.slip_velocity import ContactHeating, FallingFriction, SlipSpeed, Speed
from adhesion_jax.effects.surroundings import Drift, Humidity, Temperature
from adhesion_jax.effects.track import CurveOfTrack, LateralCreep, Patch
from adhesion_jax.effects.two_columns import Interaction as Interaction
from adhesion_jax.effects.two_columns import Surface as Surface
from adhesion_jax.effects.vehicle import AxlePosition, ModeAsymmetry
from adhesion_jax.effects.wave import RailJoint, WheelOrder

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
        "constant": Constant,
        "spline": Spline,
        "labels": Labels,
        "memory": Memory,
        "threshold": Threshold,
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


def in_words(name: str) -> str:
    """An effect's or a candidate's name within a sentence; columns stay as they are in the file."""
    kind, _, columns = name.partition(":")
    if kind == "slip_noise":  # which is found beside the effects and is none
        return "noise in the slip signal"
    if kind == "product":  # whatever the form of two columns is
        kind = "interaction"
    if kind not in KINDS:
        return kind.replace("_", " ") + (f" of {columns}" if columns else "")
    said = {"run_time_s": "the time since the run began"}.get(columns, columns)
    return KINDS[kind].FACTS.phrase.replace("{}", said)
