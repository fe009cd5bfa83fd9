"""Which names and columns count as a planted effect."""

from collections.abc import Mapping

from adhesion_jax.effects import EFFECTS

#: The columns in which a method without physics sees an effect, the one that stands for it first:
#: columns of a table, or beginnings of the names of features made of them.
_SEEN_IN: Mapping[str, tuple[str, ...]] = {
    "torsion": ("time_s", "time_in_run"),
    "unknown_column": ("rail_age_days",),
    "product": ("gradient_permille", "temperature_C", "position_m"),
    "periodic": ("groove_depth_um",),
    "speed": ("vehicle_speed_mps", "slip_velocity_mps"),
    "slip_speed": ("vehicle_speed_mps", "slip_velocity_mps"),
    "falling_friction": ("vehicle_speed_mps", "slip_velocity_mps"),
    "load_peak": ("normal_load_N",),
    "load_slope": ("normal_load_N",),
    "contact_heating": ("vehicle_speed_mps", "slip_velocity_mps"),
    "cleaning": ("work", "time_s", "time_in_run", "vehicle_speed_mps", "slip_velocity_mps"),
    "sanding": ("sanding", "sand_before"),
    "axle_position": ("axle",),
    "lateral_creep": ("curvature_per_m", "angle_of_attack_deg", "lateral_creepage"),
    "load_transfer": ("acceleration",),
    "mode_asymmetry": ("mode",),
    "relaxation": ("base_adhesion_change", "slip_size_change", "vehicle_speed_mps"),
    "delay": ("base_adhesion_change", "slip_size_change"),
    "lag": ("base_adhesion_change", "slip_size_change"),
    "hysteresis": ("base_adhesion_change", "slip_size_change"),
    "slip_bias": ("slip_ratio",),
    "torque_offset": ("slip_ratio",),
    "inertia": ("base_adhesion_change", "slip_size_change", "acceleration"),
    "slip_noise": ("base_adhesion_change", "slip_size_change"),
    "humidity": ("relative_humidity_pct",),
    "temperature": ("temperature_C",),
    "patch": ("position_m",),
    "curve": ("curvature_per_m", "position_m"),
    "wheel_order": ("wheel_angle_rad",),
    "rail_joint": ("position_m",),
    "drift": ("rail_age_days", "time_s"),
}

#: The names that say the same of what the catalogue lacks.
_SAME_AS: Mapping[str, tuple[str, ...]] = {
    "slip_noise": (),
    "torsion": ("periodic:time_s",),
    "unknown_column": ("covariate:rail_age_days",),
    "product": ("product:",),
    "periodic": ("periodic:groove_depth_um", "covariate:groove_depth_um"),
}


def seen_in(name: str) -> tuple[str, ...]:
    """The columns of an effect; of one that was added later those that its claim rests on."""
    return _SEEN_IN[name] if name in _SEEN_IN else EFFECTS[name].FACTS.rests_on


def names_for(name: str) -> tuple[str, ...]:
    """All names that count as a planted effect, its own first.

    A name that ends in a colon counts for every name that begins with it.
    """
    return (name, *(EFFECTS[name].FACTS.same_as if name in EFFECTS else _SAME_AS[name]))
