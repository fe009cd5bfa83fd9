"""The columns that the package knows: their units, the ranges of valid values, their meanings."""

import math
from collections.abc import Mapping
from typing import NamedTuple


class Column(NamedTuple):
    """A column of numbers; `advice` says what to look at where a value lies outside the range."""

    unit: str
    lower: float
    upper: float
    meaning: str
    advice: str = "check its unit"


_ANY = math.inf

#: Name to column. The ranges are wide: a value outside has a wrong unit or comes from a faulty
#: sensor.
COLUMNS: Mapping[str, Column] = {
    "time_s": Column("s", -_ANY, _ANY, "time, not decreasing within a run"),
    "vehicle_speed_mps": Column("m/s", 0.0, 200.0, "speed of the vehicle over the rail"),
    "slip_ratio": Column(
        "1",
        -1.5,
        1.5,
        "slip velocity / vehicle speed, negative when braking",
        "give the slip as a ratio, not in per cent",
    ),
    "slip_velocity_mps": Column(
        "m/s", -50.0, 50.0, "circumferential speed of the wheel less vehicle speed"
    ),
    "adhesion": Column(
        "1",
        -3.0,
        3.0,
        "tangential force / normal load, of the sign of slip",
        "give adhesion as force over load, not in per cent",
    ),
    "tangential_force_N": Column("N", -1e6, 1e6, "force along the rail, of the sign of slip"),
    "normal_load_N": Column(
        "N", 1e-3, 1e6, "wheel load, positive", "a load is positive and in newtons"
    ),
    "temperature_C": Column("degree C", -80.0, 200.0, "temperature of air, rail or wheel"),
    "relative_humidity_pct": Column("%", 0.0, 100.0, "relative humidity of the air"),
    "position_m": Column("m", -_ANY, _ANY, "position along the track"),
    "curvature_per_m": Column("1/m", -0.1, 0.1, "curvature of the track", "give it as 1/radius"),
    "angle_of_attack_deg": Column("degree", -45.0, 45.0, "yaw of the wheel to the rail"),
    "slip_angle_deg": Column(
        "degree", -45.0, 45.0, "yaw of the wheel to its path, the angle of attack of a tyre"
    ),
    "lateral_creepage": Column(
        "1",
        -0.5,
        0.5,
        "lateral slip velocity / vehicle speed",
        "give the creepage as a ratio, not in per cent",
    ),
    "sanding": Column("1", 0.0, 1.0, "sand on the rail: 0 none, 1 full"),
    "acceleration_mps2": Column("m/s^2", -50.0, 50.0, "acceleration of the vehicle"),
    "wheel_angle_rad": Column("rad", -_ANY, _ANY, "angle the wheel has turned through"),
}

#: Label of `mode`, in any case of its letters, to the sign of the driving torque.
MODES: Mapping[str, float] = {"traction": 1.0, "braking": -1.0, "coasting": 0.0}

#: Known columns whose entries are labels: any text or number will do but for `mode`.
LABELS: Mapping[str, str] = {
    "run": "number or name of the run",
    "axle": "number or name of the axle",
    "mode": ", ".join(MODES),
}
