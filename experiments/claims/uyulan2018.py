"""Uyulan et al. 2018: optimal slip seeking with an adaptive robust controller."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.report.traction.panels import Line
from adhesion_jax.report.traction.systems import lyapunov_along, lyapunov_panels
from adhesion_jax.traction.controllers.adaptive_robust import AdaptiveRobust
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.plants.base import GRAVITY, Plant
from adhesion_jax.traction.plants.elastic_axles import ElasticAxles
from adhesion_jax.traction.systems import uyulan2018
from adhesion_jax.traction.systems.uyulan2018 import PRINTED_BEST_SLIP, SURFACES, SYSTEM
from experiments.claims import uyulan2018_loops as loops
from experiments.claims.claim import TO_PRINT, Claim, Numbers, Setting, holding, is_near, values
from experiments.claims.traction import Found, Runs, on_plant, runs_of
from experiments.claims.uyulan2018_loops import PAPER, SEGMENTS, best_slip

#: Coefficients of F_roll in Eq. 19.
_ROLL = (6.4, 55.0)

#: The sign of Eq. 28 and 29 as printed: a layer that no error lies within.
_SIGN = 1e-9

_COLUMNS = ["-".join(column) for column in uyulan2018.PRINTED]

#: Power of a motor of the train, W.
_MOTOR = 1e3 * PAPER.claims["power"]["printed"]

#: Radius of a curve to which Roeckl's formula has other numbers than to that of the paper, m.
_CURVE = 300.0

#: Gains L of the observer beside ours, and how many starts there are of each.
_GAINS, _BESIDE = (100.0, 30.0, 10.0), 16


class _Columns(NamedTuple):
    """Runs of every setting in every column of Table 1: [settings, columns, ...]."""

    runs: Runs

    def figure(self, name: str, segment: str = "all") -> Numbers:
        return self.runs.figure(name, segment).reshape(-1, len(_COLUMNS))

    def worst(self, name: str) -> Numbers:
        """Of each setting, the largest of its 18 segments."""
        return np.max([self.figure(name, one) for one in SEGMENTS], axis=(0, 2))

    def axle(self, name: str) -> Numbers:
        rows = self.runs.axle(name)
        return rows.reshape(-1, len(_COLUMNS), rows.shape[-1])


def uyulan_claims(progress: Callable[[str], None]) -> Found:
    run = partial(runs_of, SYSTEM, SEGMENTS, progress)
    settings = PAPER.settings()
    tracking = [loop for one in settings for loop in loops.of_columns(one, "true optimum")]
    own, first = tracking[: len(_COLUMNS)], tracking[:: len(_COLUMNS)]
    pairs = [*zip(first, settings, strict=True)]
    tracked, by_sign, thin, graded, varied, motors, braking, tighter = run(
        "Uyulan 2018, true optimum",
        tracking,
        [loops.layered(loop, _SIGN) for loop in own],
        [loops.layered(loop, 0.01) for loop in own],
        [loops.steeper(loop) for loop in own],
        [loops.varied(*pair) for pair in pairs],
        [on_plant(loop, power_limit=jnp.asarray(_MOTOR)) for loop in first],
        [loops.braking(loop) for loop in first],
        [on_plant(loop, curve_radius=jnp.asarray(_CURVE)) for loop in first],
    )
    (sides,) = run("Uyulan 2018, sides of their own", [loops.sided(*pair) for pair in pairs])
    printed = [loop for one in settings for loop in loops.of_columns(one, "as printed")]
    slower = [
        loops.observing(loop, gain, beside)
        for gain in _GAINS
        for beside in range(_BESIDE)
        for loop in printed[: len(_COLUMNS)]
    ]
    seeking, drifting = run("Uyulan 2018, seeker as printed", printed, slower)
    (exactly,) = run("Uyulan 2018, exact slope", [loops.exact(loop) for loop in tracking])
    (axles,) = run("Uyulan 2018, axles of their own", [loops.own_rails(loop) for loop in first])
    true, sought, exact = map(_Columns, (tracked, seeking, exactly))
    sign, layers, layered = (_values(own, runs) for runs in (by_sign, thin, tracked))
    near_best = partial(_near_best, settings)
    claims = [
        *_best_slips(),
        *_table_1(true, sought, graded),
        *_columns(true, sought),
        _saturation(true, settings),
        *_lyapunov(tracked.time, sign, layers, layered),
        *_boundedness(true, settings),
        _bound_of_disturbance(own[0], tracked),
        *_convergence((true, exact, sought), near_best, drifting),
        near_best("parameters", varied.figure("tracking_rms_settled", "second")),
        *_power(true, motors, near_best, own[0].plant),
        near_best("sides", sides.each("tracking_rms_settled", ("first", "second")).max(axis=0)),
        near_best("axles", _error_of_axles(axles)),
        near_best("braking", _error_of_braking(braking)),
        near_best(
            "curve",
            tighter.each("tracking_rms_settled").max(axis=0),
            radius=_CURVE,
            tracking=tighter.figure("tracking_rms")[0],
        ),
        _roll(own[0].plant),
    ]
    worst = sought.worst("tracking_rms_settled") / best_slip()
    near = worst <= values(settings, "near")
    falling = {
        column: [
            Line("sign as printed", tracked.time, with_sign),
            Line("layer of .05 m/s in its place", tracked.time, with_layer),
        ]
        for column, with_sign, with_layer in zip(_COLUMNS, sign, layered, strict=True)
    }
    return Found(PAPER, settings, claims, 100 * worst, near, lyapunov_panels(falling))


def _near_best(settings: Sequence[Setting], key: str, error: Numbers, **facts: object) -> Claim:
    """Whether an error of slip in m/s is near, as a share of the best slip."""
    share = error / best_slip()
    return PAPER.over_settings(key, 100 * share, share <= values(settings, "near"), **facts)


# ------------------------------------------------------------------------------- on print alone


def _best_slips() -> Iterator[Claim]:
    for name, printed in PRINTED_BEST_SLIP.items():
        adhesion = float(SURFACES[name].peak(jnp.asarray(10.0)).adhesion)
        low = ", less than the .02 or so commonly given for the worst leaves" * (adhesion < 0.02)
        told = {"name": name, "adhesion": adhesion, "low": low}
        yield PAPER.near("best_slip", best_slip(name), TO_PRINT, printed=printed, **told)
    three = [PRINTED_BEST_SLIP[name] for name in ("dry", "wet", "low")]
    apart = best_slip("low") - best_slip("dry")
    spread = max(three) - min(three)
    yield PAPER.judged("best_slips_differ", apart, holding(apart != 0), printed=spread)


def _bound_of_disturbance(loop: Loop, runs: Runs) -> Claim:
    """Eq. 23 to 27 along the first six runs, with J_w and the coefficients as printed."""
    plant, law = loop.plant, loop.controller
    assert isinstance(plant, ElasticAxles)
    assert isinstance(law, AdaptiveRobust)
    inertia = float(plant.wheel_inertia)
    radius, mass = float(plant.radius[0]), float(plant.dynamic_mass)
    of_train = mass * radius**2
    per_torque = 1 / inertia + 1 / of_train
    weight = float(plant.wheel_load[0]) * GRAVITY
    sample = jax.tree.map(lambda rows: rows[: len(_COLUMNS)], runs.trace.sample)
    speed, adhesion = (np.asarray(sample.train_speed), np.asarray(sample.adhesion)[..., 0])
    gained = np.asarray(jax.vmap(jax.vmap(plant.acceleration))(sample.adhesion, sample.train_speed))
    uphill = float(plant.static_mass) * GRAVITY * np.sin(SYSTEM.slope)
    resistance = 8 * weight * adhesion - mass * gained + uphill
    psi = radius * resistance / of_train - per_torque * 2 * weight * radius * adhesion
    phi = 1 + float(law.linear) * np.abs(speed) + float(law.square) * speed**2
    kappa = radius / of_train * 1109.8 + per_torque * _largest_on_dry() * mass * GRAVITY * radius
    ours = float(np.max(np.abs(psi) / (kappa * phi)))
    return PAPER.judged("bound", ours, holding(ours < 1), psi=np.abs(psi).max(), kappa=kappa)


def _roll(plant: Plant) -> Claim:
    assert isinstance(plant, ElasticAxles)
    force = float(plant.dynamic_mass) * (_ROLL[0] + _ROLL[1] * 10.5)
    pull = 8 * float(plant.wheel_load[0]) * GRAVITY * _largest_on_dry()
    facts = {"force": force / 1e6, "pull": pull / 1e3}
    return PAPER.judged("rolling", force / pull, holding(force < pull), **facts)


def _largest_on_dry() -> float:
    """The largest adhesion of the dry surface, at the printed initial speed."""
    return float(SURFACES["dry"].peak(jnp.asarray(10.0)).adhesion)


# ----------------------------------------------------------------------------------- over settings


def _table_1(true: _Columns, sought: _Columns, graded: Runs) -> Iterator[Claim]:
    tracking, estimation = true.figure("tracking_rms"), sought.figure("estimation_rms")
    speed = np.asarray(true.runs.trace.sample.train_speed)[0]
    rim = speed + true.runs.axle("slip")[0]
    ratio = (rim - speed) / np.maximum(rim, speed)
    first = {
        "graded": ", ".join(f"{one:.4f}" for one in graded.figure("tracking_rms")),
        "rolled": np.asarray(graded.trace.sample.train_speed)[0].min(),
        "ratio": (ratio.min(), ratio.max()),
    }
    for column, printed in enumerate(uyulan2018.PRINTED.values()):
        for key, table, number, more in (
            ("table_tracking" if column else "table_first", tracking, printed[0], first),
            ("table_estimation", estimation, printed[1], {}),
        ):
            ours = table[:, column]
            facts = {"printed": number, "scenario": _COLUMNS[column], **more}
            facts |= {"off": 100 * abs(ours[0] / number - 1)}
            facts |= {"least": ours.min(), "most": ours.max()}
            yield PAPER.over_settings(key, ours, is_near(ours, number, TO_PRINT), **facts)


def _columns(true: _Columns, sought: _Columns) -> Iterator[Claim]:
    tracking, names = true.figure("tracking_rms"), np.array(_COLUMNS)
    printed = np.array([pair[0] for pair in uyulan2018.PRINTED.values()])
    ours, ratio = (rows / rows[..., :1] for rows in (tracking, printed))
    off = np.abs(ours / ratio - 1).max(axis=1)
    yield PAPER.over_settings("ratios", 100 * off, off <= TO_PRINT)
    for words, ours, best, worst in (
        ("Tracking", tracking, "dry-wet", "dry-very low"),
        ("Estimation", sought.figure("estimation_rms"), "dry-low", "dry-very low"),
    ):
        least, most = names[ours.argmin(axis=1)], names[ours.argmax(axis=1)]
        facts = {"words": words, "best": best, "worst": worst, "least": least[0], "most": most[0]}
        facts |= {"same_best": 100 * np.mean(least[1:] == best)}
        facts |= {"same_worst": 100 * np.mean(most[1:] == worst)}
        holds = (least == best) & (most == worst)
        yield PAPER.over_settings(
            "best_and_worst", ours.max(axis=1) / ours.min(axis=1), holds, **facts
        )


def _saturation(true: _Columns, settings: Sequence[Setting]) -> Claim:
    ours = true.figure("torque_largest", "third").max(axis=1)
    limit = values(settings, "plant.torque_limit") / 1e3
    column = int(true.figure("torque_largest", "third")[0].argmax())
    return PAPER.over_settings("saturation", ours, ours >= 0.999 * limit, column=_COLUMNS[column])


def _values(columns: Sequence[Loop], runs: Runs) -> Numbers:
    """The function of Lyapunov along runs, [columns, rows]; each run begins on the dry surface."""
    found = []
    for number, loop in enumerate(columns):
        controller, plant = loop.controller, loop.plant
        assert isinstance(controller, AdaptiveRobust)
        assert isinstance(plant, ElasticAxles)
        rows = jax.tree.map(lambda each, chosen=number: each[chosen], runs.trace)
        found.append(lyapunov_along(controller, plant, rows))
    return np.array(found)


class _Rises(NamedTuple):
    """Of each column, without the moments at which the rail changes."""

    share: Numbers  # of the time, %
    sum: Numbers  # of all rises, m^2/s^2


def _rises(function: Numbers, time: Numbers) -> _Rises:
    steps = np.diff(function, axis=1)
    switch = np.isin(np.round(time[1:], 6), (10.0, 20.0))
    beside = switch | np.roll(switch, 1)
    up = np.where((steps > 1e-9 * function[:, :1]) & ~beside, steps, 0.0)
    return _Rises(100 * np.mean(up[:, ~beside] > 0, axis=1), up.sum(axis=1))


def _lyapunov(time: Numbers, sign: Numbers, thin: Numbers, layered: Numbers) -> Iterator[Claim]:
    """The function on all six columns, with the sign as printed and with layers."""
    printed, *others = (_rises(function, time) for function in (sign, thin, layered))
    told = " and ".join(
        f"for .{digits} m/s in {one.share.min():.2g} to {one.share.max():.2g} % of the time, by "
        f"{one.sum.max():.1g} m²/s² in all at most"
        for digits, one in zip(("01", "05"), others, strict=True)
    )
    verdict = holding(bool(np.all(printed.share == 0.0)))
    facts = {"told": told, "start": sign[0, 0]}
    yield PAPER.judged("lyapunov", float(printed.share.mean()), verdict, **facts)
    after, before = (
        sign[:, np.searchsorted(time, np.array([10.0, 20.0]) + beside)]
        for beside in (0.005, -0.015)
    )
    jumps = np.max(after - before, axis=1)
    named = zip(_COLUMNS, jumps, strict=True)
    rises = ", ".join(f"{name} by {jump:.2g}" for name, jump in named if jump > 0)
    verdict = holding(bool(jumps.max() <= 0))
    yield PAPER.judged("lyapunov_switch", float(jumps.max()), verdict, rises=rises or "no column")


def _boundedness(true: _Columns, settings: Sequence[Setting]) -> Iterator[Claim]:
    time = true.runs.time
    error = np.abs(true.axle("slip") - true.axle("optimum"))
    settled = np.logical_or.reduce([(time > t + 2.0) & (time < t + 10.0) for t in (0, 10, 20)])
    largest = error[:, :, settled].max(axis=(1, 2))
    bound = 2 * values(settings, "near") * best_slip()
    yield PAPER.over_settings("bounded", largest, largest < bound)
    ends = np.searchsorted(time, (10.0, 20.0, 30.0)) - 1
    left = error[:, :, ends].max(axis=(1, 2))
    yield PAPER.over_settings("to_zero", left, left < 0.01)


def _convergence(
    seekers: Sequence[_Columns], near_best: Callable[..., Claim], slower: Runs
) -> Iterator[Claim]:
    each = slower.figures["tracking_rms_settled"].reshape(len(_GAINS), _BESIDE, -1)
    told = ", ".join(
        f"{100 * worst.min() / best_slip():.0f} to {100 * worst.max() / best_slip():.0f} % at L = "
        f"{gain:g}"
        for gain, worst in zip(_GAINS, np.nanmax(each, axis=2), strict=True)
    )
    for name, columns in zip(("true", "exact", "sought"), seekers, strict=True):
        used = np.min([columns.figure("utilisation_settled", one) for one in SEGMENTS], axis=(0, 2))
        facts = {"used": 100 * used[0], "beside": _BESIDE, "told": told}
        yield near_best(f"converges_{name}", columns.worst("tracking_rms_settled"), **facts)


def _power(
    true: _Columns, motors: Runs, near_best: Callable[..., Claim], plant: Plant
) -> Iterator[Claim]:
    """The power that holds slip at its best on the dry surface at the printed initial speed."""
    assert isinstance(plant, ElasticAxles)
    inertia = float(plant.gear_ratio**2 * plant.inertia[0])
    radius, ratio = float(plant.radius[0]), float(plant.gear_ratio)
    share = inertia / (float(plant.dynamic_mass) * radius**2)
    pull = 2 * radius * float(plant.wheel_load[0]) * GRAVITY * _largest_on_dry()
    downhill = float(plant.static_mass) * GRAVITY * np.sin(SYSTEM.slope)
    # Four driven axles accelerate the train; Eq. 20 has the pull of one.
    torque = (pull + share * (4 * pull - radius * downhill)) / ratio
    speed = ratio * (10.5 + best_slip()) / radius
    ours = torque * speed / 1e3
    at_end = np.abs(true.runs.axle("torque") * np.asarray(true.runs.trace.motor_speed)[..., 0])[0]
    later = at_end[np.searchsorted(true.runs.time, 9.9)] / 1e3
    yield PAPER.judged("power", ours, holding(ours <= _MOTOR / 1e3), later=later)
    used = 100 * motors.figure("utilisation", "first")[0]
    yield near_best("limited", motors.figure("tracking_rms_settled", "first"), used=used)
    yield PAPER.judged("motors", own=_MOTOR / 750, asked=1e3 * ours / 750)


def _error_of_axles(axles: Runs) -> Numbers:
    """Of the worst axle, m/s."""
    sample = axles.trace.sample
    at = axles.time > 2.0
    error = np.asarray(sample.slip - sample.optimum)[:, at & (axles.time < 10.0)]
    return np.asarray(np.sqrt(np.mean(error**2, axis=1)).max(axis=1))


def _error_of_braking(braking: Runs) -> Numbers:
    """From 2 s after its begin on, m/s; infinite where nothing is braked."""
    rows = braking.trace.sample
    at = np.asarray(rows.direction) < 0
    error = np.where(at, (np.asarray(rows.slip) - np.asarray(rows.optimum))[..., 0], np.nan)
    settled = np.cumsum(at, axis=1) * (braking.time[1] - braking.time[0]) > 2.0
    counted = np.where(settled & np.asarray(rows.counts), error, np.nan)
    seen = np.asarray(np.isfinite(counted).any(axis=1))
    mean = np.nanmean(np.where(seen[:, None], counted, 0.0) ** 2, axis=1)
    return np.where(seen, np.sqrt(mean), np.inf)
