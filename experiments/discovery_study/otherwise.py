"""Causes planted by other formulas than their own, because a real rail follows none of them."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from experiments.campaigns.plantable import Bend, CleanRuns, Form, OpenEffect, Planted, unchanged

#: How causes are planted: by the formulas of the catalogue, or by those of this module.
FORMS = ("exact", "perturbed")


def forms_of(form: str, effects: Sequence[str]) -> Mapping[str, Form]:
    """Those of these effects that have another formula, where one is asked for."""
    if form == "exact":
        return {}
    return {name: OTHERWISE[name] for name in effects if name in OTHERWISE}


def by_factor(factor: Callable[[float], np.ndarray], limit: float) -> OpenEffect:
    """Adhesion times `factor(amount)`, [runs, points]."""

    def make(amount: float) -> Planted:
        values = factor(amount)
        return planted(amount, 1, after=lambda adhesion: adhesion * values)

    return OpenEffect(make, limit)


def planted(
    amount: float, order: int, before: Bend = unchanged, after: Bend = unchanged
) -> Planted:
    """A form that has no parameter but its amount."""
    return Planted(order, before, after, unchanged, {"amount": amount})


def step(runs: CleanRuns) -> float:
    """Seconds between two points."""
    return float(np.median(np.diff(runs.columns["time_s"], axis=1)))


def speed_of(runs: CleanRuns) -> np.ndarray:
    """Vehicle speed, m/s."""
    return runs.columns["vehicle_speed_mps"]


def slip_velocity(runs: CleanRuns) -> np.ndarray:
    """Size of the slip velocity, m/s."""
    return np.abs(runs.slip) * speed_of(runs)


def rate(runs: CleanRuns, signal: np.ndarray) -> np.ndarray:
    """Central differences in time, per second."""
    return np.gradient(signal, step(runs), axis=1)


def lagged(runs: CleanRuns, signal: np.ndarray, time_constant: np.ndarray | float) -> np.ndarray:
    """First-order lag by the exact response to steps, in s; it starts settled."""
    kept = np.exp(-step(runs) / np.maximum(np.broadcast_to(time_constant, signal.shape), 1e-6))
    out = signal.copy()
    for k in range(1, signal.shape[1]):
        out[:, k] = kept[:, k] * out[:, k - 1] + (1 - kept[:, k]) * signal[:, k]
    return out


def flash(runs: CleanRuns) -> np.ndarray:
    """|l| sqrt(V), as the flash temperature goes."""
    return np.abs(runs.slip) * np.sqrt(speed_of(runs))


def direction(runs: CleanRuns) -> np.ndarray:
    """The last direction in which slip went, forgotten over .3 s."""
    return lagged(runs, np.sign(rate(runs, np.abs(runs.slip))), 0.3)


def along(runs: CleanRuns, column: str, share: float = 1.0) -> np.ndarray:
    """A column from its least on, over a share of its range."""
    values = runs.columns[column]
    return (values - values.min()) / (share * np.ptp(values))


def load_slope(runs: CleanRuns) -> OpenEffect:
    """l/(1 + a (F/F0)^2)."""
    square = (runs.columns["normal_load_N"] / runs.middle("normal_load_N")) ** 2
    return OpenEffect(lambda a: planted(a, 0, before=lambda slip: slip / (1 + a * square)), 5.0)


def cleaning(runs: CleanRuns) -> OpenEffect:
    """(1 - s) dirty + s clean, s = 1 - exp(-W/W0): two curves, as in Voltr and Lata 2015."""
    power = np.abs(runs.curve(runs.slip)) * slip_velocity(runs)
    clean = -np.expm1(-np.cumsum(power * step(runs), axis=1) / runs.generator.uniform(0.3, 1.0))
    flatter = runs.curve(0.6 * runs.slip) / runs.curve(runs.slip)
    return by_factor(lambda a: (1 - clean) * ((1 - a) * flatter**a) + clean, 0.95)


def sanding(runs: CleanRuns) -> OpenEffect:
    """1 + a s: sand arrives at once after .5 to 1 s and wears off linearly over 4 to 8 s."""
    dead = round(runs.generator.uniform(0.5, 1.0) / step(runs))
    flag = np.pad(runs.columns["sanding"], ((0, 0), (dead, 0)))[:, : runs.slip.shape[1]]
    loss = step(runs) / runs.generator.uniform(4.0, 8.0)
    sand = flag.copy()
    for k in range(1, sand.shape[1]):
        sand[:, k] = np.maximum(flag[:, k], sand[:, k - 1] - loss)
    return by_factor(lambda a: 1 + a * sand, 2.5)


def lateral_creep(runs: CleanRuns) -> OpenEffect:
    """The powers of 1.6 add up instead of the squares."""
    lateral = np.abs(np.tan(np.deg2rad(runs.columns["angle_of_attack_deg"])))

    def total(slip: np.ndarray, amount: float) -> np.ndarray:
        return (np.abs(slip) ** 1.6 + (amount * lateral) ** 1.6) ** (1 / 1.6)

    def make(amount: float) -> Planted:
        share = np.abs(runs.slip) / total(runs.slip, amount)
        return planted(
            amount,
            0,
            before=lambda slip: np.sign(slip) * total(slip, amount),
            after=lambda adhesion: adhesion * share,
        )

    return OpenEffect(make, 30.0)


def mode_asymmetry(runs: CleanRuns) -> OpenEffect:
    """1 - a |l|/(|l| + .01) in braking."""
    braking = (runs.slip < 0) * np.abs(runs.slip) / (np.abs(runs.slip) + 0.01)
    return by_factor(lambda a: 1 - a * braking, 0.95)


def humidity(runs: CleanRuns) -> OpenEffect:
    """1 - a/(1 + exp(-(H - c)/w)), c and w drawn."""
    centre, width = runs.generator.uniform(50.0, 75.0), runs.generator.uniform(5.0, 10.0)
    wet = 1 / (1 + np.exp(-(runs.columns["relative_humidity_pct"] - centre) / width))
    return by_factor(lambda a: 1 - a * wet, 0.95)


def patch(runs: CleanRuns) -> OpenEffect:
    """1 - a (1 + cos(pi u))/2, u the distance from the middle over a reach of 70 to 150 m."""
    position = runs.columns["position_m"]
    centre = float(np.quantile(position, runs.generator.uniform(0.3, 0.7)))
    place = np.clip((position - centre) / runs.generator.uniform(70.0, 150.0), -1, 1)
    bump = 0.5 * (1 + np.cos(np.pi * place))
    return by_factor(lambda a: 1 - a * bump, 0.95)


def curve(runs: CleanRuns) -> OpenEffect:
    """1 - a |kappa|/(|kappa| + 1/km)."""
    bent = np.abs(runs.columns["curvature_per_m"])
    return by_factor(lambda a: 1 - a * bent / (bent + 1e-3), 0.95)


def wheel_order(runs: CleanRuns) -> OpenEffect:
    """1 + a (sin(n theta + b) + .3 sin(2 (n theta + b) + 1))."""
    turn = runs.columns["wheel_angle_rad"] * int(runs.generator.integers(1, 4))
    turn = turn + runs.generator.uniform(0, 2 * np.pi)
    return by_factor(lambda a: 1 + a * (np.sin(turn) + 0.3 * np.sin(2 * turn + 1)), 0.7)


def rail_joint(runs: CleanRuns) -> OpenEffect:
    """Narrow dips at the joints: 1 - a exp(-(u/.15)^2), u the rail lengths from the joint."""
    length = runs.generator.uniform(9.0, 33.0)
    places = runs.columns["position_m"] / length + runs.generator.uniform(0, 1)
    dip = np.exp(-((np.abs(places % 1 - 0.5) / 0.15) ** 2))
    return by_factor(lambda a: 1 - a * dip, 0.95)


def relaxation(runs: CleanRuns) -> OpenEffect:
    """The length shrinks as the contact slides: s/(1 + |l|/.05)."""
    share = 1 / (1 + np.abs(runs.slip) / 0.05) / speed_of(runs)
    return OpenEffect(
        lambda a: planted(a, 3, after=lambda adhesion: lagged(runs, adhesion, a * share)), 90.0
    )


def delay(runs: CleanRuns) -> OpenEffect:
    """Not the same in every run: a tenth of spread."""
    clock = runs.columns["time_s"] - runs.columns["time_s"][:, :1]
    spread = 1 + 0.1 * runs.generator.standard_normal((len(clock), 1))

    def late(adhesion: np.ndarray, amount: float) -> np.ndarray:
        each = zip(clock - amount * spread, clock, adhesion, strict=True)
        return np.stack([np.interp(*run) for run in each])

    return OpenEffect(lambda a: planted(a, 3, after=lambda adhesion: late(adhesion, a)), 4.0)


def lag(runs: CleanRuns) -> OpenEffect:
    """Two filters of half the time constant, one after the other."""

    def twice(adhesion: np.ndarray, amount: float) -> np.ndarray:
        return lagged(runs, lagged(runs, adhesion, amount / 2), amount / 2)

    return OpenEffect(lambda a: planted(a, 3, after=lambda adhesion: twice(adhesion, a)), 10.0)


def slip_bias(_: CleanRuns) -> OpenEffect:
    """A wrong radius stretches the slip a little as well: l + a sign(l) (1 + |l|)."""

    def biased(slip: np.ndarray, amount: float) -> np.ndarray:
        return slip + amount * np.sign(slip) * (1 + np.abs(slip))

    return OpenEffect(lambda a: planted(a, 0, before=lambda slip: biased(slip, a)), 0.04)


def torque_offset(runs: CleanRuns) -> OpenEffect:
    """Mu + a (1 + .3 V/15) sign(l): friction in the bearings grows with the speed."""
    loss = (1 + 0.3 * speed_of(runs) / 15) * np.sign(runs.slip)
    return OpenEffect(lambda a: planted(a, 3, after=lambda adhesion: adhesion + a * loss), 0.3)


def inertia(runs: CleanRuns) -> OpenEffect:
    """The acceleration has passed a filter of .15 s."""
    filtered = lagged(runs, rate(runs, speed_of(runs) * (1 + runs.slip)), 0.15)
    return OpenEffect(lambda a: planted(a, 3, after=lambda adhesion: adhesion + a * filtered), 0.9)


def product(runs: CleanRuns) -> OpenEffect:
    """1 + a (T - mean)/10 K tanh(gradient/8), .05 at least."""
    celsius = runs.columns["temperature_C"]
    warm = (celsius - np.mean(celsius)) / 10
    steep = np.tanh(runs.columns["gradient_permille"] / 8)
    return by_factor(lambda a: np.maximum(1 + a * warm * steep, 0.05), 0.6)


def periodic(runs: CleanRuns) -> OpenEffect:
    """1 + a sign(s) |s|^.6, s the sine of the phase."""
    wave = np.sin(2 * np.pi * runs.columns["groove_depth_um"] / runs.generator.uniform(11.0, 29.0))
    return by_factor(lambda a: 1 + a * np.sign(wave) * np.abs(wave) ** 0.6, 0.9)


#: Factors of adhesion in which nothing is drawn, of the runs and an amount, and the largest amount.
_FACTORS: Mapping[str, tuple[Callable[[CleanRuns, float], np.ndarray], float]] = {
    "speed": (lambda runs, a: 1 / (1 + a * speed_of(runs) / 20), 5.0),
    "slip_speed": (lambda runs, a: 1 / (1 + a * slip_velocity(runs)) ** 2, 5.0),
    "falling_friction": (lambda runs, a: 1 - a + a / (1 + slip_velocity(runs) / 0.6), 0.95),
    "load_peak": (lambda runs, a: 1 - a * (runs.columns["normal_load_N"] / 150e3) ** 2, 0.95),
    "contact_heating": (lambda runs, a: 1 / (1 + a * flash(runs)), 20.0),
    "axle_position": (lambda runs, a: 1 + a * (1 - 0.5 ** (runs.columns["axle"] - 1)), 2.5),
    "load_transfer": (lambda runs, a: 1 + a * np.tanh(rate(runs, speed_of(runs)) / 0.5), 0.9),
    "temperature": (lambda runs, a: 1 + a * along(runs, "temperature_C") ** 2, 2.0),
    "drift": (lambda runs, a: 1 + a * np.expm1(-along(runs, "time_s", 0.3)), 0.95),
    "hysteresis": (lambda runs, a: 1 + a * direction(runs), 0.9),
    "unknown_column": (lambda runs, a: 1 + a * np.expm1(-along(runs, "rail_age_days", 0.4)), 0.95),
}


def _by_formula(factor: Callable[[CleanRuns, float], np.ndarray], limit: float) -> Form:
    return lambda runs: by_factor(lambda amount: factor(runs, amount), limit)


#: The other formula of each cause; noise has its own alone.
OTHERWISE: Mapping[str, Form] = {
    **{name: _by_formula(*one) for name, one in _FACTORS.items()},
    **{
        form.__name__: form
        for form in (
            *(load_slope, cleaning, sanding, lateral_creep, mode_asymmetry, humidity, patch, curve),
            *(wheel_order, rail_joint, relaxation, delay, lag, slip_bias, torque_offset, inertia),
            *(product, periodic),
        )
    },
}
