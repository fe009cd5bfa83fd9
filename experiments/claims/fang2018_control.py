"""Fang et al. 2018: torque feedback of the adhesion observed, in the loop."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from adhesion_jax.report.traction.panels import Line, Mark, Panel
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.plants.base import GRAVITY
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.systems.fang2018 import (
    CRITICAL,
    PRINTED_BEST_SLIP_KMH,
    PRINTED_SLIP_KMH,
    SEGMENTS,
    SYSTEM,
)
from experiments.claims.claim import (
    ASSUMED,
    CANNOT_BE_CHECKED,
    PRINTED,
    READ_OFF,
    REPAIRED,
    TO_PRINT,
    Claim,
    Verdict,
    holding,
    is_near,
    judged,
    near,
    of_settings,
)
from experiments.claims.fang2018 import FANG2018
from experiments.claims.fang2018_settings import (
    DURATION,
    POOR,
    RANGES,
    SLOPE_GAINS,
    bench_delay,
    bench_loop,
    critical_gain_of,
    loop_of,
    rate_loop,
    slope_loop,
    threshold_loop,
)
from experiments.claims.settings import (
    Cloud,
    Found,
    Numbers,
    Setting,
    drawn,
    over_settings,
    values,
)
from experiments.claims.traction import Runs, runs_of

_claim = partial(over_settings, FANG2018)


_K2 = 7000.0

#: K1 over 19000 N m^2/s where it is swept at our setting. At 0 the train never starts.
_SWEEP = (0.3, 1.0, 2.0, 3.6, 10.0, 30.0, 100.0)

#: Dead times of the bus, s.
_DELAYS = (0.001, 0.005, 0.02, 0.1)


def control_claims(progress: Callable[[str], None]) -> Found:
    settings = drawn(RANGES)
    plain = [loop_of(setting) for setting in settings]
    kinds = {
        "m/s": [slope_loop(*pair, _K2) for pair in zip(plain, settings, strict=True)],
        "km/h": [
            slope_loop(*pair, _K2, SLOPE_GAINS["km/h"])
            for pair in zip(plain, settings, strict=True)
        ],
        "large": [
            slope_loop(loop, one, 18000 / CRITICAL * critical_gain_of(loop))
            for loop, one in zip(plain, settings, strict=True)
        ],
        "beyond": [
            slope_loop(loop, one, one["margin"] * critical_gain_of(loop))
            for loop, one in zip(plain, settings, strict=True)
        ],
        "excessive": [
            slope_loop(loop, one, _K2, one["excess"] * SLOPE_GAINS["m/s"])
            for loop, one in zip(plain, settings, strict=True)
        ],
    }
    swept = [slope_loop(plain[0], settings[0], _K2, share * SLOPE_GAINS["m/s"]) for share in _SWEEP]
    together = _run([*(loop for kind in kinds.values() for loop in kind), *swept])
    count = len(settings)
    slopes = {
        kind: together.part(count * number, count * (number + 1))
        for number, kind in enumerate(kinds)
    }
    sweep = together.part(count * len(kinds), None)
    progress("Fang 2018, Eq. 9")
    rates = _run(
        [
            *(rate_loop(*pair, 0.0) for pair in zip(plain, settings, strict=True)),
            *(rate_loop(*pair, pair[1]["engaged"]) for pair in zip(plain, settings, strict=True)),
            *(
                rate_loop(*pair, 0.0, pair[1]["open_loop"])
                for pair in zip(plain, settings, strict=True)
            ),
        ]
    )
    rest, engaged, open_loop = (rates.part(count * n, count * (n + 1)) for n in range(3))
    progress("Fang 2018, Eq. 8")
    thresholds = _run([threshold_loop(*pair) for pair in zip(plain, settings, strict=True)])
    progress("Fang 2018, thresholds")
    delayed = _delayed(kinds["m/s"])
    progress("Fang 2018, bench")
    claims = [
        *(claim for unit in SLOPE_GAINS for claim in _slips(slopes[unit], unit, slopes["large"])),
        *(_near_the_peak(slopes[unit], unit, settings) for unit in SLOPE_GAINS),
        *_torques(slopes["km/h"]),
        _observed(slopes["m/s"]),
        _no_idling(slopes["m/s"]),
        *_rate_feedback(rest, engaged, plain),
        _open_loop(open_loop, settings),
        _thresholds(thresholds, slopes["large"]),
        _recovers(slopes["large"]),
        _beyond(slopes["beyond"], settings),
        _larger(slopes["km/h"], slopes["m/s"]),
        _excessive(slopes["excessive"], slopes["m/s"], sweep),
        _critical_gain(plain[0]),
        _disturbance(plain[0]),
        _bench(delayed, slopes["m/s"]),
    ]
    used = _least_used(slopes["km/h"])
    cloud = Cloud(
        "Fang et al. 2018: with K1 = 19000 for slip in km/h and K2 = 7000 near the peak\n"
        "(near, at least 90 to 99 % of the adhesion, is drawn with the settings)",
        "largest adhesion of road 2 (1)",
        values(settings, "second"),
        "adhesion used on the worse road (%)",
        100 * used,
        used >= values(settings, "near"),
    )
    return Found(claims, cloud, _of_gain(sweep))


def _run(loops: Sequence[Loop]) -> Runs:
    return runs_of(SYSTEM._replace(duration=DURATION), SEGMENTS, loops)


def _kmh(runs: Runs, road: str) -> Numbers:
    return 3.6 * runs.figure("slip_settled", road)


def _slips(runs: Runs, unit: str, large: Runs) -> list[Claim]:
    found = []
    for road, printed in PRINTED_SLIP_KMH.items():
        ours = _kmh(runs, road)
        found.append(
            _claim(
                f"With K1 = 19000 for slip in {unit} and K2 = 7000 slip settles on road {road} "
                f"(Fig. 12, to {READ_OFF:.0%})",
                ours,
                "km/h",
                is_near(ours, printed, READ_OFF),
                f"The unit of K1 is not printed, and the figures have slip in km/h. K2 = 18000 N m "
                f"gives {_kmh(large, road)[0]:.2f} km/h at our setting.",
                printed,
            )
        )
    return found


def _least_used(runs: Runs) -> Numbers:
    """Of the adhesion, on the worse of the two poor roads; nothing where one is not reached."""
    used = [runs.figure("utilisation_settled", road) for road in POOR]
    return np.nan_to_num(np.min(used, axis=0))


def _near_the_peak(runs: Runs, unit: str, settings: Sequence[Setting]) -> Claim:
    each = [runs.figure("utilisation_settled", road)[0] for road in POOR]
    used = _least_used(runs)
    return _claim(
        f"With K1 = 19000 for slip in {unit} and K2 = 7000 the wheel runs near the peak (Fig. 11)",
        100 * used,
        "% of the largest adhesion",
        used >= values(settings, "near"),
        f"{100 * each[0]:.1f} % on road 2 and {100 * each[1]:.1f} % on road 3 at our setting; near "
        "is read as 90 to 99 % of the largest adhesion, drawn with the settings.",
    )


def _torques(runs: Runs) -> list[Claim]:
    sample = runs.trace.sample
    torque, segment = runs.axle("torque")[0], np.asarray(sample.segment)[0]
    counts = np.asarray(sample.counts)[0]
    ours = [float(np.median(torque[counts & (segment == SEGMENTS.index(road))])) for road in POOR]
    return [
        judged(
            FANG2018,
            claim,
            number,
            "N m",
            Verdict(CANNOT_BE_CHECKED),
            ASSUMED,
            remark,
            printed,
        )
        for claim, number, printed, remark in (
            (
                "The torques commanded on roads 2 and 3 are 5.8 and 4.9 N m (Fig. 8)",
                np.nan,
                5.8,
                "They are those of a bench of 5.5 kW, whose scale is not printed. Their ratio, "
                "1.18, is that of the largest adhesion of the two roads, and was used to choose "
                "it.",
            ),
            (
                "The bench of 5.5 kW stands for the axle by one scale (section 4.1)",
                ours[0],
                np.nan,
                f"With K1 for slip in km/h ours are {ours[0]:.0f} and {ours[1]:.0f} N m on roads 2 "
                f"and 3, {ours[0] / 5.8:.0f} and {ours[1] / 4.9:.0f} times those of Fig. 8. The "
                "scale is not printed, nor is what dSPACE computes at which step.",
            ),
        )
    ]


def _observed(runs: Runs) -> Claim:
    largest = np.max([runs.axle("largest")], axis=(0, 2))
    ours = 100 * runs.figure("adhesion_rms") / largest
    return _claim(
        "The adhesion observed agrees with the actual one in the loop (Fig. 10, RMSE below 5 % of "
        "the largest)",
        ours,
        "% of the largest adhesion",
        ours < 5.0,
        "Without noise, in traction: what is left is the lag of the observer, whose poles are not "
        "printed, after a switch.",
    )


def _no_idling(runs: Runs) -> Claim:
    over = np.max([runs.figure("overshoot", road) for road in POOR], axis=0) * 3.6
    away = np.max([runs.figure("ran_away", road) for road in POOR], axis=0)
    return _claim(
        "Idling is avoided when the road gets worse (Fig. 7; slip stays below five times the best)",
        over,
        "km/h beyond the best slip",
        np.nan_to_num(away, nan=1.0) == 0,
        "The largest excess on roads 2 and 3, with K1 = 19000 for slip in m/s and K2 = 7000.",
    )


def _rate_feedback(rest: Runs, engaged: Runs, loops: Sequence[Loop]) -> list[Claim]:
    stood = rest.figure("stood")
    torque = np.abs(engaged.axle("torque"))
    second_half = torque[:, torque.shape[1] // 2 :].mean(axis=1)
    demand = np.array([float(loop.driver.traction) for loop in loops])
    reached = 3.6 * np.asarray(engaged.trace.sample.train_speed).max(axis=1)
    return [
        judged(
            FANG2018,
            "With Eq. 8 a train does not start from rest",
            100 * float(stood[0]),
            "% of the run at rest",
            holding(bool(np.all(stood == 1.0))),
            PRINTED,
            "At rest adhesion and its rate are zero, and so is the torque, whatever the gains: so "
            "in all of the settings drawn.",
        ),
        _claim(
            "With Eq. 8 the torque dies away and the train coasts",
            second_half,
            "N m, mean of the second half",
            second_half < 0.05 * demand,
            "Below the speed at which it takes over, 30 km/h at our setting, the driver's demand "
            f"stands: the train gets to {reached[0]:.0f} km/h and stays there. Dying away is read "
            "as less than 5 % of the demand; with larger gains the torque swings instead.",
        ),
    ]


def _open_loop(runs: Runs, settings: Sequence[Setting]) -> Claim:
    away = np.nan_to_num(runs.figure("ran_away", "3"), nan=1.0)
    used = _least_used(runs)
    moved = 3.6 * np.asarray(runs.trace.sample.train_speed).max(axis=1)
    return _claim(
        "With an open-loop torque C beside Eq. 8 the train runs, and slip does not run away when "
        "the road gets worse (section 1, on its reference 9)",
        100 * used,
        "% of the largest adhesion, worse road",
        (moved > 85.0) & (away == 0),
        f"C is constant here, {settings[0]['open_loop']:g} N m at our setting, at which the train "
        f"gets to {moved[0]:.0f} km/h. It is near the peak in "
        f"{100 * np.mean(used[1:] > 0.95):.0f} % of the settings: C has to be right for the road.",
    )


def _thresholds(runs: Runs, large: Runs) -> Claim:
    used, fed = _least_used(runs), _least_used(large)
    return _claim(
        "Thresholds of speed difference and creepage use less of the adhesion (section 1)",
        100 * used,
        "% of the largest adhesion, worse road",
        used < fed,
        f"Against Eq. 9 with K2 = 18000 N m for the plant of our setting, where that uses "
        f"{100 * fed[0]:.1f} %. It acts once a wheel slips, unloads and comes back along a ramp.",
    )


def _recovers(runs: Runs) -> Claim:
    """Road 3 begins with the slip of road 2, which may be beyond its peak."""
    best = PRINTED_BEST_SLIP_KMH["3"]
    slip, segment = 3.6 * runs.axle("slip"), np.asarray(runs.trace.sample.segment)
    third = segment == SEGMENTS.index("3")
    first = slip[np.arange(len(slip)), third.argmax(axis=1)]
    settled = _kmh(runs, "3")
    begins = third.any(axis=1) & (first > best)
    verdict = of_settings((settled < best)[1:][begins[1:]])
    return judged(
        FANG2018,
        f"On road 3 slip comes back from the unstable side of the peak at {best:g} km/h (Fig. 12)",
        float(settled[0]),
        "km/h",
        verdict,
        ASSUMED,
        f"With K2 = .885 K2_TH, of the {begins[1:].sum()} of {len(begins) - 1} settings in which "
        f"road 3 begins beyond its peak; at our setting from {first[0]:.1f} km/h. The paper's own "
        "K2 = 7000 hardly ever gets there.",
        PRINTED_SLIP_KMH["3"],
    )


def _beyond(runs: Runs, settings: Sequence[Setting]) -> Claim:
    second, third = (_kmh(runs, road) for road in POOR)
    peaks = values(settings, "second_slip")
    calm = np.nan_to_num(runs.figure("ran_away", "3"), nan=1.0) == 0
    right = (second > peaks) & (third > PRINTED_BEST_SLIP_KMH["3"])
    return _claim(
        "With K2 above K2_TH the wheel runs on the right of the peak, near it (Eq. 18)",
        third,
        "km/h on road 3",
        right & calm,
        f"1.02 K2_TH at our setting: {second[0]:.2f} km/h on road 2 (peak at {peaks[0]:.3g}). "
        f"On the right in {100 * np.mean(right[1:]):.0f} % of the settings; slip runs away in "
        f"{100 * np.mean(~calm[1:]):.0f} %.",
    )


def _larger(large: Runs, small: Runs) -> Claim:
    more, less = _least_used(large), _least_used(small)
    return _claim(
        "A larger K1 uses more of the adhesion (section 3.2)",
        100 * (more - less),
        "% points on the worse road",
        more > less,
        f"K1 = 19000 for slip in km/h against K1 = 19000 for slip in m/s, which is 3.6 times less, "
        f"both with K2 = 7000: {100 * more[0]:.1f} against {100 * less[0]:.1f} % at our setting.",
    )


def _variation(runs: Runs) -> Numbers:
    """Of the torque, on the worse of the two poor roads, kN m/s."""
    return np.max([runs.figure("torque_variation", road) for road in POOR], axis=0)


def _excessive(runs: Runs, plain: Runs, sweep: Runs) -> Claim:
    most, least = _variation(runs), _variation(plain)
    told = ", ".join(
        f"{100 * used:.0f} and {varied:.2g} at {1e-3 * share * SLOPE_GAINS['m/s']:g}"
        for share, used, varied in zip(_SWEEP, _least_used(sweep), _variation(sweep), strict=True)
    )
    return _claim(
        "An excessive K1 leads to severe fluctuation of the torque (section 3.2; more than twice)",
        most / least,
        "times the torque's variation",
        most > 2 * least,
        f"Ten times K1 = 19000 at our setting, without noise: {most[0]:.2f} against "
        f"{least[0]:.2f} kN m/s on the worse road. On the worse road the adhesion used in % and "
        f"the variation in kN m/s are, by K1 in 1000 N m²/s: {told}.",
    )


def _critical_gain(loop: Loop) -> Claim:
    """The gain at which the bracket of Eq. 17 vanishes, with the signs as printed."""
    plant = loop.plant
    assert isinstance(plant, RigidAxles)
    ours = critical_gain_of(loop)
    weight = plant.axle_load[0] * GRAVITY
    train = float(plant.gear_ratio * plant.inertia[0] / plant.wheel_radius[0])
    as_printed = ours - 2 * train * float(weight / plant.train_mass)
    return judged(
        FANG2018,
        "K2_TH of Eq. 18 is what makes the bracket of Eq. 17 vanish",
        as_printed / ours,
        "times K2_TH",
        near(as_printed, ours, TO_PRINT),
        PRINTED,
        "Eq. 17 has the term of the train with a plus inside a difference: its bracket vanishes "
        f"at {as_printed:.0f} N m, and Eq. 18 gives {ours:.0f} N m for the train of our setting. "
        "Eq. 14 is on the side of Eq. 18.",
    )


def _disturbance(loop: Loop) -> Claim:
    plant = loop.plant
    assert isinstance(plant, RigidAxles)
    coefficients = (plant.resistance_a, plant.resistance_b, plant.resistance_c)
    ours = float(sum(k * 380.0**n for n, k in enumerate(coefficients)))
    return judged(
        FANG2018,
        f"The disturbance C is .198 m/s² at 380 km/h (section 3.2, to {TO_PRINT:.0%})",
        ours,
        "m/s²",
        near(ours, 0.198, TO_PRINT),
        REPAIRED,
        "With the resistance that is commonly quoted for a CRH2A, whose coefficients the paper "
        "does not print.",
        0.198,
    )


class _Delayed(NamedTuple):
    """Settled slips in km/h on the two poor roads, behind a bus."""

    delay: Numbers  # s, [settings]: each has one of the dead times, ours that of the bench
    slips: Numbers  # [roads, settings]
    ours: Numbers  # [roads, dead times], of our setting at each of them


def _delayed(loops: Sequence[Loop]) -> _Delayed:
    """The dead times in turn over the settings."""
    drawn_ones = len(loops) - 1
    turn = np.array([_DELAYS.index(bench_delay()), *(np.arange(drawn_ones) % len(_DELAYS))])
    slips, ours = np.empty((len(POOR), len(loops))), []
    for place, delay in enumerate(_DELAYS):
        chosen = np.flatnonzero(turn == place)
        runs = _run([bench_loop(loops[number], delay) for number in (0, *chosen)])
        found = np.array([_kmh(runs, road) for road in POOR])
        ours.append(found[:, 0])
        slips[:, chosen] = found[:, 1:]
    return _Delayed(np.array(_DELAYS)[turn], slips, np.array(ours).T)


def _bench(delayed: _Delayed, plain: Runs) -> Claim:
    at_once = np.array([_kmh(plain, road) for road in POOR])
    off = np.abs(delayed.slips / at_once - 1).max(axis=0)
    ours = np.abs(delayed.ours / at_once[:, :1] - 1).max(axis=0)
    told = ", ".join(
        f"{100 * one:.1f} % at {1e3 * delay:g} ms" for delay, one in zip(_DELAYS, ours, strict=True)
    )
    holds = off <= READ_OFF
    longest = (delayed.delay == max(_DELAYS))[1:]
    return _claim(
        "A bus from the control to the drive leaves the settled slips as they are "
        f"(to {READ_OFF:.0%})",
        100 * off,
        "% off at most",
        holds,
        "The bench sends its commands by CAN, whose delay is not printed: 1 to 100 ms, in turn "
        f"over the settings, of which {100 * np.mean(holds[1:][longest]):.0f} % with 100 ms hold. "
        f"Off at our setting: {told}.",
    )


def _of_gain(sweep: Runs) -> list[Panel]:
    gains = np.array(_SWEEP) * SLOPE_GAINS["m/s"] / 1e3
    label = "K1 (1000 N m²/s)"
    marks = [
        Mark("19000 for slip in m/s and in km/h", x=gain / 1e3) for gain in SLOPE_GAINS.values()
    ]
    return [
        Panel(title, label, y_label, [Line("our setting", gains, rows)], marks, ratio=True)
        for title, y_label, rows in (
            ("adhesion used, worse road", "adhesion used (%)", 100 * _least_used(sweep)),
            ("fluctuation, worse road", "change of torque (kN m/s)", _variation(sweep)),
        )
    ]
