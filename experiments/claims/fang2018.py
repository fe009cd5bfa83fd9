"""Fang et al. 2018: torque feedback of the adhesion observed, in the loop, over settings."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import jax.numpy as jnp
import numpy as np

from adhesion_jax.report.traction.panels import Line, Mark, Panel
from adhesion_jax.traction.controllers.readhesion import Threshold
from adhesion_jax.traction.controllers.torque_feedback import RateFeedback, SlopeFeedback
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.plants.base import GRAVITY
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.rails import BySpeed, stacked
from adhesion_jax.traction.surface import with_peak
from adhesion_jax.traction.systems.base import built
from adhesion_jax.traction.systems.fang2018 import (
    CRITICAL,
    PRINTED_BEST_SLIP_KMH,
    PRINTED_SLIP_KMH,
    SEGMENTS,
    SYSTEM,
)
from experiments.claims.claim import (
    READ_OFF,
    TO_PRINT,
    Claim,
    Flags,
    Numbers,
    Setting,
    holding,
    is_near,
    near,
    of_settings,
    read_paper,
    values,
)
from experiments.claims.traction import (
    Found,
    Runs,
    changed,
    numbers_of,
    on_plant,
    plant_of,
    runs_of,
)

PAPER = read_paper("fang2018")

#: K1 = 19000 with the slip in m/s, and with the slip in km/h as in every figure of the paper.
_K1 = {"m/s": 19000.0, "km/h": 3.6 * 19000.0}

_K2 = 7000.0

#: K1 over 19000 N m^2/s where it is swept at our setting. At 0 the train never starts.
_SWEEP = (0.3, 1.0, 2.0, 3.6, 10.0, 30.0, 100.0)

#: Dead times of the bus, s.
_DELAYS = (0.001, 0.005, 0.02, 0.1)

_POOR = ("2", "3")

#: Runs each kind of loops through the traction part alone: the roads of braking are those of it.
_run = partial(runs_of, SYSTEM._replace(duration=150.0), SEGMENTS)


def control_claims(progress: Callable[[str], None]) -> Found:
    settings = PAPER.settings()
    plain = [_loop(setting) for setting in settings]
    pairs = [*zip(plain, settings, strict=True)]
    critical = [critical_gain_of(loop) for loop in plain]
    large = [18000 / CRITICAL * gain for gain in critical]
    beyond = [one["margin"] * gain for one, gain in zip(settings, critical, strict=True)]
    excessive = [one["excess"] * _K1["m/s"] for one in settings]
    slow = [_slope(*pair) for pair in pairs]
    slopes = _run(
        progress,
        "Fang 2018, Eq. 9",
        slow,
        [_slope(*pair, slope_gain=_K1["km/h"]) for pair in pairs],
        [_slope(*pair, gain) for pair, gain in zip(pairs, large, strict=True)],
        [_slope(*pair, gain) for pair, gain in zip(pairs, beyond, strict=True)],
        [_slope(*pair, slope_gain=gain) for pair, gain in zip(pairs, excessive, strict=True)],
        [_slope(*pairs[0], slope_gain=share * _K1["m/s"]) for share in _SWEEP],
    )
    rates = _run(
        progress,
        "Fang 2018, Eq. 8",
        [_rate(*pair) for pair in pairs],
        [_rate(*pair, engaged_kmh=pair[1]["engaged"]) for pair in pairs],
        [_rate(*pair, open_loop=pair[1]["open_loop"]) for pair in pairs],
    )
    (thresholds,) = _run(progress, "Fang 2018, thresholds", [_threshold(*pair) for pair in pairs])
    claims = [
        *_of_slope(slopes, settings),
        *_of_rate(rates, settings, plain),
        _thresholds(thresholds, slopes[2]),
        _recovers(slopes[2]),
        _beyond(slopes[3], settings),
        _larger(slopes[1], slopes[0]),
        _excessive(slopes[4], slopes[0], slopes[5]),
        *_on_print(plain[0]),
        _bench(slow, slopes[0], progress),
    ]
    used = _least_used(slopes[1])
    near_best = used >= values(settings, "near")
    return Found(PAPER, settings, claims, 100 * used, near_best, _of_gain(slopes[5]))


# -------------------------------------------------------------------------------------- the loops


def _loop(setting: Setting) -> Loop:
    """The loop of a setting, under the first controller of the system."""
    plant = plant_of(SYSTEM)
    given = numbers_of(setting, "plant").items()
    plant = changed(plant, **{name: one + 0 * getattr(plant, name) for name, one in given})
    third = setting["second"] / setting["second_over_third"]
    slips = {"1": 6.5, "2": setting["second_slip"], "3": 4.0}
    heights = {"1": 0.2, "2": setting["second"], "3": third}
    roads = {
        name: with_peak(heights[name], slip / 3.6, setting["curve"]) for name, slip in slips.items()
    }
    own = SYSTEM.cases(SYSTEM.step)[0]
    assert isinstance(own.rails, BySpeed)
    surfaces = stacked([roads[name[0]] for name in SEGMENTS])
    case = own._replace(
        rails=changed(own.rails, surfaces=surfaces),
        observer=FullDimension(jnp.asarray(setting["pole"])),
    )
    loop = built(SYSTEM, case, plant)
    limit = jnp.asarray(setting["plant.torque_limit"])
    return changed(loop, driver=changed(loop.driver, traction=limit, braking=limit))


def critical_gain_of(loop: Loop) -> float:
    """K2_TH in N m (Eq. 18)."""
    plant = loop.plant
    assert isinstance(plant, RigidAxles)
    weight = plant.axle_load[0] * GRAVITY
    radius, gear = plant.wheel_radius[0], plant.gear_ratio
    held = radius * weight / (gear * plant.gear_efficiency)
    return float(held + gear * plant.inertia[0] / radius * weight / plant.train_mass)


def _slope(loop: Loop, setting: Setting, gain: float = _K2, slope_gain: float = _K1["m/s"]) -> Loop:
    gains = {"slope_gain": jnp.asarray(slope_gain), "adhesion_gain": jnp.asarray(gain)}
    gains |= {"filter_time": jnp.asarray(setting["filter_time"])}
    return changed(loop, controller=SlopeFeedback(**gains, **numbers_of(setting, "slope")))


def _rate(loop: Loop, setting: Setting, engaged_kmh: float = 0.0, open_loop: float = 0.0) -> Loop:
    gain = setting["rate_share"] * critical_gain_of(loop)
    numbers = (setting["rate_gain"], gain, setting["filter_time"], engaged_kmh / 3.6, open_loop)
    return changed(loop, controller=RateFeedback(*map(jnp.asarray, numbers)))


def _threshold(loop: Loop, setting: Setting) -> Loop:
    return changed(loop, controller=Threshold(**numbers_of(setting, "threshold")))


# ------------------------------------------------------------------------------------- the claims


def _kmh(runs: Runs, road: str) -> Numbers:
    return 3.6 * runs.figure("slip_settled", road)


def _least_used(runs: Runs) -> Numbers:
    """Of the adhesion, on the worse of the two poor roads; nothing where one is not reached."""
    return np.nan_to_num(runs.each("utilisation_settled", _POOR).min(axis=0))


def _variation(runs: Runs) -> Numbers:
    """Of the torque, on the worse of the two poor roads, kN m/s."""
    return runs.each("torque_variation", _POOR).max(axis=0)


def _stays(runs: Runs, road: str) -> Flags:
    """Whether slip does not run away on a road that is reached."""
    return np.asarray(np.nan_to_num(runs.figure("ran_away", road), nan=1.0) == 0)


def _of_slope(slopes: Sequence[Runs], settings: Sequence[Setting]) -> Iterator[Claim]:
    """Eq. 9 with K2 as printed, K1 in both units."""
    of_unit = dict(zip(_K1, slopes, strict=False))
    for unit, runs in of_unit.items():
        for road, printed in PRINTED_SLIP_KMH.items():
            ours, large = _kmh(runs, road), _kmh(slopes[2], road)[0]
            holds, told = is_near(ours, printed, READ_OFF), {"road": road, "large": large}
            yield PAPER.over_settings("settles", ours, holds, printed=printed, unit=unit, **told)
    for unit, runs in of_unit.items():
        used, each = _least_used(runs), 100 * runs.each("utilisation_settled", _POOR)[:, 0]
        holds = used >= values(settings, "near")
        yield PAPER.over_settings("near_peak", 100 * used, holds, unit=unit, each=each)
    sample = of_unit["km/h"].trace.sample
    torque, segment, counts = (
        np.asarray(rows)[0] for rows in (sample.torque[..., 0], sample.segment, sample.counts)
    )
    second, third = (
        float(np.median(torque[counts & (segment == SEGMENTS.index(road))])) for road in _POOR
    )
    told = {"second": second, "third": third, "on_third": third / 4.9}
    told |= {"on_second": second / PAPER.claims["torques"]["printed"]}
    yield PAPER.judged("torques")
    yield PAPER.judged("bench_scale", second, **told)
    plain = of_unit["m/s"]
    off = 100 * plain.figure("adhesion_rms") / plain.axle("largest").max(axis=1)
    yield PAPER.over_settings("observed", off, off < 5.0)
    over = plain.each("overshoot", _POOR).max(axis=0) * 3.6
    away = plain.each("ran_away", _POOR).max(axis=0)
    yield PAPER.over_settings("no_idling", over, np.nan_to_num(away, nan=1.0) == 0)


def _of_rate(
    rates: Sequence[Runs], settings: Sequence[Setting], loops: Sequence[Loop]
) -> Iterator[Claim]:
    """Eq. 8 from rest, from a speed on, and with an open-loop torque beside."""
    rest, engaged, open_loop = rates
    stood = rest.figure("stood")
    yield PAPER.judged("rest", 100 * float(stood[0]), holding(bool(np.all(stood == 1.0))))
    torque = np.abs(engaged.axle("torque"))
    second_half = torque[:, torque.shape[1] // 2 :].mean(axis=1)
    demand = np.array([float(loop.driver.traction) for loop in loops])
    reached, moved = (
        3.6 * np.asarray(runs.trace.sample.train_speed).max(axis=1) for runs in (engaged, open_loop)
    )
    holds = second_half < 0.05 * demand
    yield PAPER.over_settings("dies_away", second_half, holds, reached=reached[0])
    used, holds = _least_used(open_loop), (moved > 85.0) & _stays(open_loop, "3")
    facts = {"demand": settings[0]["open_loop"], "moved": moved[0]}
    facts |= {"near": 100 * np.mean(used[1:] > 0.95)}
    yield PAPER.over_settings("open_loop", 100 * used, holds, **facts)


def _thresholds(runs: Runs, large: Runs) -> Claim:
    used, fed = _least_used(runs), _least_used(large)
    return PAPER.over_settings("thresholds", 100 * used, used < fed, fed=100 * fed[0])


def _recovers(runs: Runs) -> Claim:
    """Road 3 begins with the slip of road 2, which may be beyond its peak."""
    best = PRINTED_BEST_SLIP_KMH["3"]
    slip, segment = 3.6 * runs.axle("slip"), np.asarray(runs.trace.sample.segment)
    third = segment == SEGMENTS.index("3")
    first = slip[np.arange(len(slip)), third.argmax(axis=1)]
    settled = _kmh(runs, "3")
    begins = third.any(axis=1) & (first > best)
    facts = {"printed": PRINTED_SLIP_KMH["3"], "best": best, "first": first[0]}
    facts |= {"begins": begins[1:].sum(), "drawn": len(begins) - 1}
    verdict = of_settings((settled < best)[1:][begins[1:]])
    return PAPER.judged("recovers", settled[0], verdict, **facts)


def _beyond(runs: Runs, settings: Sequence[Setting]) -> Claim:
    second, third = (_kmh(runs, road) for road in _POOR)
    peaks, calm = values(settings, "second_slip"), _stays(runs, "3")
    right = (second > peaks) & (third > PRINTED_BEST_SLIP_KMH["3"])
    shares = {"right": 100 * np.mean(right[1:]), "away": 100 * np.mean(~calm[1:])}
    told = {"second": second[0], "peak": peaks[0]}
    return PAPER.over_settings("beyond", third, right & calm, **told, **shares)


def _larger(large: Runs, small: Runs) -> Claim:
    more, less = _least_used(large), _least_used(small)
    facts = {"more": 100 * more[0], "less": 100 * less[0]}
    return PAPER.over_settings("larger", 100 * (more - less), more > less, **facts)


def _excessive(runs: Runs, plain: Runs, sweep: Runs) -> Claim:
    most, least = _variation(runs), _variation(plain)
    told = ", ".join(
        f"{100 * used:.0f} and {varied:.2g} at {1e-3 * share * _K1['m/s']:g}"
        for share, used, varied in zip(_SWEEP, _least_used(sweep), _variation(sweep), strict=True)
    )
    facts = {"most": most[0], "least": least[0], "told": told}
    return PAPER.over_settings("excessive", most / least, most > 2 * least, **facts)


def _on_print(loop: Loop) -> Iterator[Claim]:
    plant, ours = loop.plant, critical_gain_of(loop)
    assert isinstance(plant, RigidAxles)
    # The gain at which the bracket of Eq. 17 vanishes, with the signs as printed.
    train = float(plant.gear_ratio * plant.inertia[0] / plant.wheel_radius[0])
    as_printed = ours - 2 * train * float(plant.axle_load[0] * GRAVITY / plant.train_mass)
    verdict = near(as_printed, ours, TO_PRINT)
    gains = {"as_printed": as_printed, "gain": ours}
    yield PAPER.judged("critical_gain", as_printed / ours, verdict, **gains)
    coefficients = (plant.resistance_a, plant.resistance_b, plant.resistance_c)
    resistance = float(sum(k * 380.0**n for n, k in enumerate(coefficients)))
    yield PAPER.near("disturbance", resistance, TO_PRINT)


def _bench(loops: Sequence[Loop], plain: Runs, progress: Callable[[str], None]) -> Claim:
    """Behind a bus, whose dead times take turns over the settings; ours is that of the bench."""
    own = float(read_plant(shipped()["fang2018_bench"]).plant.dead_time)
    turn = np.array([_DELAYS.index(own), *(np.arange(len(loops) - 1) % len(_DELAYS))])
    at_once = np.array([_kmh(plain, road) for road in _POOR])
    off, told = np.empty(len(loops)), []
    for place, delay in enumerate(_DELAYS):
        chosen = np.array([0, *np.flatnonzero(turn == place)])
        late = [on_plant(loops[number], dead_time=jnp.asarray(delay)) for number in chosen]
        (runs,) = _run(lambda _: None, "", late)
        slips = np.array([_kmh(runs, road) for road in _POOR])
        found = np.abs(slips / at_once[:, chosen] - 1).max(axis=0)
        told.append(f"{100 * found[0]:.1f} % at {1e3 * delay:g} ms")
        off[chosen[1:]] = found[1:]
    progress("Fang 2018, bench")
    holds, longest = off <= READ_OFF, turn[1:] == len(_DELAYS) - 1
    facts = {"longest": 100 * np.mean(holds[1:][longest]), "told": ", ".join(told)}
    return PAPER.over_settings("bench", 100 * off, holds, **facts)


def _of_gain(sweep: Runs) -> list[Panel]:
    gains = np.array(_SWEEP) * _K1["m/s"] / 1e3
    marks = [Mark("19000 for slip in m/s and in km/h", x=gain / 1e3) for gain in _K1.values()]

    def panel(title: str, label: str, rows: Numbers) -> Panel:
        lines = [Line("our setting", gains, rows)]
        return Panel(f"{title}, worse road", "K1 (1000 N m²/s)", label, lines, marks, ratio=True)

    return [
        panel("adhesion used", "adhesion used (%)", 100 * _least_used(sweep)),
        panel("fluctuation", "change of torque (kN m/s)", _variation(sweep)),
    ]
