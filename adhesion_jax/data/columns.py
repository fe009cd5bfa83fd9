"""The quantities that the package knows: their units, valid ranges, and what users call them."""

import math
from collections.abc import Mapping
from typing import NamedTuple


class Column(NamedTuple):
    """A column of numbers; `advice` says what to look at where a value lies outside the range.

    Where the largest size of all values lies outside `usual`, a warning is given: the values are
    possible, but of the size that another unit would give. `plain` is what the quantity is called
    where its unit is told beside it; `synonyms` are names by which it is recognised in a file,
    in small letters, where no other quantity has them too.
    """

    unit: str
    lower: float
    upper: float
    meaning: str
    plain: str
    synonyms: tuple[str, ...] = ()
    advice: str = "check its unit"
    usual: tuple[float, float] = (0.0, math.inf)


_ANY = math.inf

#: What the standard deviation of a quantity is called.
_SD = (
    "{} sd",
    "{} std",
    "sd {}",
    "std {}",
    "sigma {}",
    "error of {}",
    "{} ±",
    "{} +",
    "±{}",
    "+ {}",
    "standard deviation of {}",
)

#: Name to column. The ranges are wide: a value outside has a wrong unit or comes from a faulty
#: sensor.
COLUMNS: Mapping[str, Column] = {
    "time_s": Column(
        "s",
        -1e10,
        1e10,
        "time, not decreasing within a run",
        "time",
        (
            "t",
            "zeit",
            "zeitstempel",
            "timestamp",
            "time stamp",
            "uhrzeit",
            "datum uhrzeit",
            "datum zeit",
            "datetime",
            "date time",
            "elapsed time",
            "messzeit",
        ),
        "seconds are wanted, not a stamp in milliseconds or nanoseconds",
    ),
    "vehicle_speed_mps": Column(
        "m/s",
        0.0,
        200.0,
        "speed of the vehicle over the rail",
        "vehicle_speed",
        (
            "speed",
            "v",
            "train speed",
            "v train",
            "geschwindigkeit",
            "fahrgeschwindigkeit",
            "zuggeschwindigkeit",
            "fahrzeuggeschwindigkeit",
            "v zug",
            "v fzg",
            "v ist",
        ),
        usual=(0.0, 85.0),
    ),
    "wheel_speed_mps": Column(
        "m/s",
        -5.0,
        250.0,
        "circumferential speed of the wheel",
        "wheel_speed",
        (
            "v wheel",
            "v rad",
            "vw",
            "radgeschwindigkeit",
            "radumfangsgeschwindigkeit",
            "umfangsgeschwindigkeit",
            "circumferential speed",
        ),
        usual=(0.0, 110.0),
    ),
    "wheel_rotation_radps": Column(
        "rad/s",
        -10.0,
        600.0,
        "angular speed of the wheel",
        "wheel_rotation",
        (
            "raddrehzahl",
            "wheel rpm",
            "n rad",
            "n wheel",
            "omega wheel",
            "omega rad",
            "radsatzdrehzahl",
            "angular wheel speed",
            "wheel angular speed",
        ),
    ),
    "slip_ratio": Column(
        "1",
        -1.5,
        1.5,
        "slip velocity / vehicle speed, negative when braking",
        "slip",
        ("schlupf", "creep", "creepage", "longitudinal creepage", "längsschlupf", "lambda", "λ"),
        "give the slip as a ratio, not in per cent",
    ),
    "slip_velocity_mps": Column(
        "m/s",
        -50.0,
        50.0,
        "circumferential speed of the wheel less vehicle speed",
        "slip_velocity",
        ("slip speed", "schlupfgeschwindigkeit", "gleitgeschwindigkeit", "delta v", "dv"),
    ),
    "adhesion": Column(
        "1",
        -3.0,
        3.0,
        "tangential force / normal load, of the sign of slip",
        "adhesion",
        (
            "mu",
            "µ",
            "μ",
            "adhesion coefficient",
            "coefficient of adhesion",
            "kraftschluss",
            "kraftschlussbeiwert",
            "reibwert",
            "traction coefficient",
            "cof",
        ),
        "give adhesion as force over load, not in per cent",
    ),
    "adhesion_sd": Column(
        "1",
        1e-9,
        3.0,
        "standard deviation of the adhesion in the row, positive",
        "adhesion_sd",
        tuple(words.format(mu) for words in _SD for mu in ("mu", "µ", "adhesion", "cof")),
        "a standard deviation is positive, and in the unit of the adhesion",
        usual=(1e-5, 0.3),
    ),
    "repeats": Column(
        "1",
        1.0,
        1e9,
        "number of measurements of which the adhesion in the row is the mean",
        "repeats",
        advice="the adhesion is the mean of one measurement or more",
    ),
    "tangential_force_N": Column(
        "N",
        -1e6,
        1e6,
        "force of one wheel along the rail, of the sign of slip",
        "wheel_force",
        ("tangential force", "radkraft", "umfangskraft am rad", "zugkraft je rad", "zugkraft rad"),
    ),
    "axle_force_N": Column(
        "N",
        -2e6,
        2e6,
        "force of both wheels of an axle along the rail, of the sign of slip",
        "axle_force",
        (
            "force per axle",
            "zugkraft je achse",
            "achszugkraft",
            "zugkraft achse",
            "radsatzzugkraft",
        ),
    ),
    "locomotive_force_N": Column(
        "N",
        -2e7,
        2e7,
        "force of all driven wheels along the rail, of the sign of slip",
        "locomotive_force",
        ("zugkraft lok", "lokzugkraft", "zugkraft lokomotive", "zugkraft gesamt"),
    ),
    "motor_torque_Nm": Column(
        "Nm",
        -1e6,
        1e6,
        "torque of the motor of one axle, of the sign of slip",
        "motor_torque",
        ("torque", "motormoment", "drehmoment", "motordrehmoment", "antriebsmoment", "m motor"),
    ),
    "normal_load_N": Column(
        "N",
        1e-3,
        1e6,
        "load on one wheel, positive",
        "wheel_load",
        ("normal load", "radlast", "radaufstandskraft"),
        "a load is positive and in newtons",
        usual=(200.0, 5e5),
    ),
    "axle_load_N": Column(
        "N",
        1e-3,
        2e6,
        "load on both wheels of an axle, positive",
        "axle_load",
        ("achslast", "radsatzlast", "load per axle"),
        "a load is positive",
        usual=(400.0, 1e6),
    ),
    "locomotive_load_N": Column(
        "N",
        1e-3,
        2e7,
        "load on all driven wheels, positive",
        "locomotive_load",
        (
            "lokmasse",
            "lokgewicht",
            "reibungsmasse",
            "adhesive weight",
            "locomotive weight",
            "reibungslast",
            "adhesive mass",
            "locomotive mass",
        ),
        "a load is positive",
        usual=(2000.0, 1e7),
    ),
    "driven_axles": Column(
        "1",
        1.0,
        32.0,
        "number of driven axles of the locomotive",
        "driven_axles",
        ("number of driven axles", "treibachsen", "angetriebene achsen", "anzahl treibachsen"),
        "give the number of axles that have a motor",
    ),
    "temperature_C": Column(
        "degree C",
        -80.0,
        200.0,
        "temperature of air, rail or wheel",
        "temperature",
        (
            "temp",
            "t air",
            "temperatur",
            "lufttemperatur",
            "schienentemperatur",
            "t luft",
            "air temperature",
            "t schiene",
            "t rail",
            "t",
        ),
    ),
    "relative_humidity_pct": Column(
        "%",
        0.0,
        100.0,
        "relative humidity of the air",
        "humidity",
        (
            "relative humidity",
            "rh",
            "feuchte",
            "luftfeuchte",
            "rel feuchte",
            "relative feuchte",
            "luftfeuchtigkeit",
            "relative luftfeuchte",
            "rf",
        ),
    ),
    "position_m": Column(
        "m",
        -_ANY,
        _ANY,
        "position along the track",
        "position",
        ("weg", "strecke", "kilometrierung", "streckenkilometer", "distance", "chainage", "x"),
    ),
    "curvature_per_m": Column(
        "1/m",
        -0.1,
        0.1,
        "curvature of the track",
        "curvature",
        ("krümmung", "kruemmung"),
        "give it as 1/radius",
    ),
    "angle_of_attack_deg": Column(
        "degree",
        -45.0,
        45.0,
        "yaw of the wheel to the rail",
        "angle_of_attack",
        ("anlaufwinkel",),
    ),
    "slip_angle_deg": Column(
        "degree",
        -45.0,
        45.0,
        "yaw of the wheel to its path, the angle of attack of a tyre",
        "slip_angle",
        ("schräglaufwinkel",),
    ),
    "lateral_creepage": Column(
        "1",
        -0.5,
        0.5,
        "lateral slip velocity / vehicle speed",
        "lateral_creepage",
        ("querschlupf", "lateral creep", "lateral slip"),
        "give the creepage as a ratio, not in per cent",
    ),
    "sanding": Column(
        "1", 0.0, 1.0, "sand on the rail: 0 none, 1 full", "sanding", ("sand", "sanden", "sandung")
    ),
    "acceleration_mps2": Column(
        "m/s^2",
        -50.0,
        50.0,
        "acceleration of the vehicle",
        "acceleration",
        ("a", "beschleunigung", "längsbeschleunigung", "a x"),
        usual=(0.0, 20.0),
    ),
    "wheel_angle_rad": Column(
        "rad", -_ANY, _ANY, "angle the wheel has turned through", "wheel_angle", ("radwinkel",)
    ),
}

#: Label of `mode`, in any case of its letters, to the sign of the driving torque.
MODES: Mapping[str, float] = {"traction": 1.0, "braking": -1.0, "coasting": 0.0}

#: Known columns whose entries are labels: any text or number will do but for `mode`.
LABELS: Mapping[str, str] = {
    "run": "number or name of the run",
    "axle": "number or name of the axle",
    "mode": ", ".join(MODES),
    "group": "what a comparison by a column goes by: any text or number",
}

#: Names by which columns of labels are recognised, in small letters.
LABEL_SYNONYMS: Mapping[str, tuple[str, ...]] = {
    "run": ("run", "lauf", "fahrt", "versuch", "messfahrt", "sweep"),
    "axle": ("axle", "achse", "radsatz", "wheelset"),
    "mode": (),
    "group": (),
}

#: What a standard deviation is called in the column right after that of its adhesion, and what the
#: number of repeats is called where a column has the standard deviation; in small letters, with a
#: space in the place of a hyphen or slash.
SD_AFTER = ("sd", "std", "stdev", "sigma", "standard deviation", "error", "±", "+")
REPEATS_BESIDE = ("n", "count", "n repeats", "number of repeats", "wiederholungen", "anzahl")

#: Words that tell a quantity but not of which body, and the columns among which to choose.
UNDECIDED: Mapping[str, tuple[str, ...]] = {
    "force": ("tangential_force_N", "axle_force_N", "locomotive_force_N"),
    "load": ("normal_load_N", "axle_load_N", "locomotive_load_N"),
    "rotation": ("wheel_rotation_radps",),
}
