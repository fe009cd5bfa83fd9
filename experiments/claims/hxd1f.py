"""The HXD1F of 2019: extremum seeking with a sliding mode and a barrier controller.

The tables of the paper are lost in the text at hand, so that almost every number is ours: its
claims are judged over settings.
"""

from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.observers import Observer
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measurement
from adhesion_jax.traction.surface import with_peak
from adhesion_jax.traction.systems.hxd1f import STARTS, SURFACES, SYSTEM
from experiments.claims.claim import (
    ASSUMED,
    CANNOT_BE_CHECKED,
    Claim,
    Verdict,
    judged,
)
from experiments.claims.hxd1f_settings import (
    LOAD,
    RANGES,
    differential_loop,
    loop_of,
    narrow_loop,
    own_axles_loop,
    sampled_loop,
    sliding_loop,
)
from experiments.claims.settings import (
    Cloud,
    Flags,
    Found,
    Numbers,
    Setting,
    drawn,
    over_settings,
    values,
)
from experiments.claims.traction import Runs, changed, runs_of

_PAPER = "HXD1F 2019"
_claim = partial(over_settings, _PAPER)


#: "Good" use of a rail is read as this share of the largest adhesion, at least.
_GOOD = 0.9

_SEGMENTS = (*SURFACES,)


#: Lags of the torque in s, and upper ends of the interval of the barrier in m/s.
_INTERVALS = ((2e-4, 0.05), (1e-2, 0.20), (1e-2, 0.22))


def hxd1f_claims(progress: Callable[[str], None]) -> Found:
    """Each form of the loop at our own setting, then at those drawn."""
    settings = drawn(RANGES)
    plain = [loop_of(setting) for setting in settings]
    narrow = [narrow_loop(plain[0], *pair) for pair in _INTERVALS]
    found = _run([*plain, *narrow])
    progress("HXD1F 2019")
    seeking = found.part(0, len(settings))
    sampled = _run([sampled_loop(loop, sampled=1e-3) for loop in plain])
    progress("HXD1F 2019, speed held")
    slow = _run(
        [
            changed(loop, observer=FullDimension(jnp.asarray(setting["observer_pole"])))
            for loop, setting in zip(plain, settings, strict=True)
        ]
    )
    progress("HXD1F 2019, full dimension")
    differential = _run(
        [differential_loop(*pair) for pair in zip(plain, settings, strict=True)],
    )
    progress("HXD1F 2019, differential acceleration")
    pairs = [*zip(plain, settings, strict=True)]
    sliding = _run([*(sliding_loop(*pair) for pair in pairs), sliding_loop(*pairs[0], layer=0.05)])
    progress("HXD1F 2019, sliding mode")
    axles = _run([own_axles_loop(loop) for loop in plain])
    progress("HXD1F 2019, axles of their own")
    held = values(settings, "sampling") >= 0.5
    claims = [
        *_observers(plain, settings, seeking, slow),
        _at_the_switches(seeking, sampled, held),
        *_search_times(seeking, sampled, held),
        _snow(seeking, sampled, held),
        _neighbourhood(settings),
        *_against_differential(seeking, differential),
        *_against_sliding(seeking, sliding),
        _interval(seeking, found.part(len(settings), len(settings) + len(narrow)), settings),
        _no_skid(seeking, sampled, held),
        _each_axle(axles),
        *_beyond_reach(plain[0]),
    ]
    runs = (seeking, sampled)
    cloud = Cloud(
        "HXD1F 2019: on the dry rail the best slip is found after 1 s",
        "speed k of the seeker (m/s²)",
        values(settings, "seeker_speed"),
        "adhesion used on the dry rail (%)",
        100 * _either([each.figure("utilisation", "dry") for each in runs], held),
        _either([each.figure("t95", "dry") for each in runs], held) <= 1.0,
    )
    return Found(claims, cloud)


def _run(loops: Sequence[Loop]) -> Runs:
    return runs_of(SYSTEM, _SEGMENTS, loops)


@jax.jit
@jax.vmap
def _observed(observer: Observer, nominal: Plant) -> jax.Array:
    """The load observed while a constant one acts, from none, step by step."""
    step = SYSTEM.step

    def one(
        both: tuple[jax.Array, object], _: jax.Array
    ) -> tuple[tuple[jax.Array, object], jax.Array]:
        speed, state = both
        measured = Measurement(speed, jnp.asarray(5.0), jnp.zeros(1), jnp.full(1, LOAD))
        state = observer.update(state, nominal, measured, jnp.full(1, 5000.0), step)
        speed = speed + step * (5000.0 - LOAD) / nominal.inertia
        return (speed, state), state.load[0]

    speed = jnp.full(1, 50.0)
    first = observer.init(nominal, Measurement(speed, jnp.asarray(5.0), jnp.zeros(1), jnp.zeros(1)))
    return jax.lax.scan(one, (speed, first), jnp.arange(2000))[1]


def settling(observers: Sequence[Observer], plants: Sequence[Plant]) -> tuple[Numbers, Numbers]:
    """Time in s from which the load observed stays within 2 % of a constant one, from none; and
    the mean error of the last .1 s, as a share of the load.

    Means over 2 ms, since a sliding mode chatters around the load. Infinite where it never does.
    """
    stacked = (jax.tree.map(lambda *x: jnp.stack(x), *parts) for parts in (observers, plants))
    block = round(2e-3 / SYSTEM.step)
    found = np.asarray(_observed(*stacked))
    means = found.reshape(len(found), -1, block).mean(axis=2)
    off = np.abs(means / LOAD - 1) > 0.02
    last = off.shape[1] - np.argmax(off[:, ::-1], axis=1)
    times = np.where(off.any(axis=1), last, 0) * block * SYSTEM.step
    times = np.where(off[:, -1], np.inf, times)
    return times, np.abs(found[:, -1000:].mean(axis=1) / LOAD - 1)


def _observers(
    loops: Sequence[Loop], settings: Sequence[Setting], seeking: Runs, slow: Runs
) -> list[Claim]:
    plants = [loop.nominal for loop in loops]
    sliding, left = settling([loop.observer for loop in loops], plants)
    poles = [FullDimension(jnp.asarray(setting["observer_pole"])) for setting in settings]
    double, _ = settling(poles, plants)
    wet = [float(runs.figure("utilisation", "wet")[0]) for runs in (seeking, slow)]
    return [
        _claim(
            "The sliding observer tracks adhesion after .025 s (Fig. 10)",
            sliding,
            "s",
            sliding <= 0.025,
            "Until it stays within 2 % of a constant load, as a mean over 2 ms.",
            printed=0.025,
        ),
        _claim(
            "The error of the sliding observer converges to zero in a finite time (Theorem 1)",
            100 * left,
            "% of the load",
            left < 1e-3,
            "What is left of the error between .1 and .2 s, as a mean; less than .1 % counts as "
            "zero. The sliding mode chatters around it with the step of 0.1 ms.",
        ),
        _claim(
            "The sliding observer is faster than the full-dimension one (Fig. 10 and 18)",
            sliding,
            "s",
            sliding < double,
            f"A double pole at -233 1/s needs {double[0]:.3f} s; one at {-5.83 / sliding[0]:.0f} "
            "1/s would be as fast, with more noise. With the slower one the seeker uses "
            f"{100 * wet[1]:.0f} % of the wet rail instead of {100 * wet[0]:.0f} %: there the lag "
            "decides. That number is one of a limit cycle, and of the machine.",
        ),
    ]


def _either(pair: Sequence[Numbers], held: Flags) -> Numbers:
    """Of an unsampled and of a sampled speed, the value of each setting under what it has."""
    return np.where(held, pair[1], pair[0])


def _at_the_switches(seeking: Runs, sampled: Runs, held: Flags) -> Claim:
    def worst(runs: Runs) -> Numbers:
        time = runs.time
        error = np.abs(runs.axle("observed") - runs.axle("adhesion"))
        after = [(time > start + 0.025) & (time < start + 0.525) for start in STARTS[1:]]
        largest = [runs.axle("largest")[:, moments].max(axis=1) for moments in after]
        rms = [np.sqrt(np.mean(error[:, moments] ** 2, axis=1)) for moments in after]
        return np.max(np.array(rms) / np.array(largest), axis=0)

    ours = 100 * _either([worst(seeking), worst(sampled)], held)
    return _claim(
        "After the switches at 5 and 10 s the adhesion observed is accurate (Fig. 10; RMSE below "
        "5 % of the largest)",
        ours,
        "% of the largest adhesion",
        ours < 5.0,
        "From .025 s after a switch on, for half a second, on the worse of the two rails. A "
        "sliding mode chatters around the load, the more so where the speed is held for 1 ms.",
    )


def _search_times(seeking: Runs, sampled: Runs, held: Flags) -> list[Claim]:
    found = []
    for surface, printed in (("dry", 1.0), ("wet", 0.8)):
        plain, with_held = (runs.figure("t95", surface) for runs in (seeking, sampled))
        ours = _either([plain, with_held], held)
        kept = _either([runs.figure("utilisation", surface) for runs in (seeking, sampled)], held)
        shares = [100 * np.mean(times[1:] <= printed) for times in (plain, with_held)]
        found.append(
            _claim(
                f"On the {surface} rail the best slip is found after {printed:g} s (Fig. 12)",
                ours,
                "s",
                ours <= printed,
                f"From when on 95 % of the largest adhesion is kept for .3 s; {100 * kept[0]:.1f} "
                f"% is used over the five seconds at our setting, and {100 * np.median(kept):.0f} "
                f"% in the median. All settings with a speed that is not sampled: {shares[0]:.0f} "
                f"% of them; all with one that is held for 1 ms: {shares[1]:.0f} %.",
                printed=printed,
            )
        )
    return found


def _snow(seeking: Runs, sampled: Runs, held: Flags) -> Claim:
    used = _either([runs.figure("utilisation", "snow") for runs in (seeking, sampled)], held)
    return _claim(
        f"On snow the search is good too (at least {_GOOD:.0%} of the largest adhesion)",
        100 * used,
        "% of the largest adhesion",
        used >= _GOOD,
        f"The median of the settings is {100 * np.median(used):.0f} %. At our setting it never "
        "keeps 95 % for .3 s: the limit cycle around the peak is wider there.",
    )


def _neighbourhood(settings: Sequence[Setting]) -> Claim:
    """Slips about the peak at which k |dmu/dv_s| < rho, and the seeker does not slide."""

    def steep(largest: float, best: float, one: Setting) -> tuple[float, bool]:
        """How far below the peak it is steep enough, in m/s, and whether it is beyond the peak."""
        slips = jnp.linspace(1e-4, 6 * best, 60_000)
        law = with_peak(largest, best, one["curve"])
        slope = np.abs(np.asarray(jax.vmap(jax.grad(law))(slips, jnp.full_like(slips, 5.0))))
        enough = slope > one["seeker_rise"] / one["seeker_speed"]
        left, right = (np.asarray(slips)[enough & side] for side in (slips < best, slips > best))
        return best - (float(left.max()) if len(left) else 0.0), len(right) > 0

    found = {
        name: [
            steep(one[name], one["snow_slip"] if best is None else best, one) for one in settings
        ]
        for name, best in (("dry", 0.2), ("wet", 0.08), ("snow", None))
    }
    wide = {name: band for name, ((band, _), *_) in found.items()}
    beyond = np.array([[right for _, right in rows] for rows in found.values()])
    share = np.array([band for band, _ in found["dry"]]) / 0.2
    return _claim(
        "The slip converges in the neighbourhood of the optimum (Theorem 4, Remarks 5 and 6; "
        "nearer than half of the best slip on the dry rail)",
        100 * share,
        "% of the best slip",
        share < 0.5,
        "It slides where k |dμ/dv| > rho, so up to "
        f"{wide['dry']:.2f} m/s below the best slip on the dry rail, {wide['wet']:.3f} on "
        f"the wet and {wide['snow']:.3f} on the snowy one: nearer than that nothing draws it "
        "to the peak. Beyond the peak, Case 1 of the theorem, the curves are "
        f"{'somewhere' if beyond[:, 0].any() else 'nowhere'} steep enough at our setting, and on "
        f"some rail in {100 * np.mean(beyond[:, 1:].any(axis=0)):.0f} % of the settings.",
    )


def _against_differential(seeking: Runs, differential: Runs) -> list[Claim]:
    at = (seeking.time > 2) & (seeking.time < 5)
    swings = [runs.axle("slip")[:, at].std(axis=1) for runs in (seeking, differential)]
    reached = np.nan_to_num(differential.figure("t95", "dry"), nan=np.inf)
    sought = np.nan_to_num(seeking.figure("t95", "dry"), nan=np.inf)
    used = [runs.figure("utilisation") for runs in (seeking, differential)]
    pull = [np.asarray(runs.trace.sample.pull).mean(axis=1) for runs in (seeking, differential)]
    return [
        _claim(
            "Differential acceleration control swings more in slip than the seeker (Fig. 12)",
            swings[1] / swings[0],
            "times its deviation",
            swings[1] > swings[0],
            f"Standard deviations of slip from 2 to 5 s on the dry rail, {swings[1][0]:.3f} and "
            f"{swings[0][0]:.3f} m/s at our setting.",
        ),
        _claim(
            "Differential acceleration control is slow at the start (Fig. 12 and 13)",
            differential.figure("utilisation", "dry") * 100,
            "% of the dry rail",
            reached > sought,
            "Until 95 % of the largest adhesion is kept for .3 s on the dry rail, later than the "
            "seeker or never; a setting in which neither ever keeps it counts against the claim. "
            f"At our setting it {_when(reached[0])}, the seeker {_when(sought[0])}.",
        ),
        _claim(
            "The locomotive achieves maximum traction: it pulls more than with differential "
            "acceleration control",
            pull[0] / pull[1],
            "times the mean force",
            pull[0] > pull[1],
            f"Over all three rails the seeker uses {100 * used[0][0]:.1f} % of the adhesion at our "
            f"setting, the other {100 * used[1][0]:.1f} %.",
        ),
    ]


def _when(time: float) -> str:
    return f"does so after {time:.2f} s" if np.isfinite(time) else "never does"


def _against_sliding(seeking: Runs, sliding: Runs) -> list[Claim]:
    layer = sliding.part(len(sliding.trace.time) - 1, len(sliding.trace.time))
    sign = sliding.part(0, len(seeking.trace.time))
    varied = [runs.figure("torque_variation", "dry") for runs in (seeking, sign, layer)]
    lost = [runs.figure("slip_energy_share") for runs in (seeking, sign)]
    return [
        _claim(
            "The barrier controller has a smoother torque than a sliding mode (Fig. 15)",
            varied[1] / varied[0],
            "times its variation",
            varied[1] > varied[0],
            f"On the dry rail {varied[0][0]:.1f} against {varied[1][0]:.0f} kN m/s at our setting, "
            f"and {varied[2][0]:.1f} kN m/s where the sliding mode has a layer of .05 m/s: what is "
            "smoother is the absence of a sign, not the barrier.",
        ),
        _claim(
            "The barrier controller reduces the loss against a sliding mode (Fig. 15)",
            lost[1] / lost[0],
            "times its slip energy",
            lost[1] > lost[0],
            "Energy lost in the contact per useful work over the three rails, "
            f"{100 * lost[0][0]:.2f} % against {100 * lost[1][0]:.2f} % at our setting. Chatter "
            "helps the seeker along, and so it may lose more.",
        ),
    ]


def _largest_error(runs: Runs) -> Numbers:
    return np.max((runs.axle("slip") - runs.axle("asked"))[:, 1:], axis=1)


def _interval(seeking: Runs, narrow: Runs, settings: Sequence[Setting]) -> Claim:
    """Theorem 7 is about a torque without lag; with one the interval must be wide enough."""
    above = values(settings, "barrier_above")
    ours = _largest_error(seeking)
    quick, *slow = _largest_error(narrow)
    told = ", ".join(
        f"{limit:g} m/s: {error:.3f}"
        for (_, limit), error in zip(_INTERVALS[1:], slow, strict=True)
    )
    return _claim(
        "The error stays within the interval of the barrier (Theorem 7)",
        ours,
        "m/s",
        ours < above,
        f"At our setting the interval ends at {above[0]:g} m/s. The theorem knows no lag of the "
        f"torque: with one of .2 ms an interval of .05 m/s holds an error of {quick:.3f} m/s; with "
        f"one of 10 ms the largest error is, for intervals of {told}.",
    )


def _no_skid(seeking: Runs, sampled: Runs, held: Flags) -> Claim:
    def worst(runs: Runs) -> Numbers:
        """The longest stretch beyond twice the best slip, s."""
        beyond = np.abs(runs.axle("slip")) > 2 * np.abs(runs.axle("optimum"))
        count, most = np.zeros(len(beyond)), np.zeros(len(beyond))
        for moment in beyond.T:
            count = np.where(moment, count + 1, 0)
            most = np.maximum(most, count)
        return most * (runs.time[1] - runs.time[0])

    ours = _either([worst(seeking), worst(sampled)], held)
    furthest = np.max(np.abs(seeking.axle("slip")) / np.abs(seeking.axle("optimum")), axis=1)
    return _claim(
        "The wheels do not skid when the rail changes (never beyond twice the best slip)",
        ours,
        "s beyond twice the best slip",
        ours == 0.0,
        f"Slip goes to {seeking.axle('slip')[0].max():.2f} m/s at our setting, "
        f"{furthest[0]:.1f} times the best slip of its rail. For less than the second that a "
        f"search takes it is beyond in {100 * np.mean(ours[1:] < 1.0):.0f} % of the settings.",
    )


def _each_axle(axles: Runs) -> Claim:
    sample = axles.trace.sample
    used = np.mean(np.asarray(sample.adhesion) / np.asarray(sample.largest), axis=1)
    worst = used.min(axis=1)
    return _claim(
        f"Eight axles of two units, each with its own load, use the rails (at least {_GOOD:.0%} "
        "each)",
        100 * worst,
        "% of the largest adhesion, worst axle",
        worst >= _GOOD,
        f"Each axle has an observer, a seeker and a barrier of its own. At our setting the best "
        f"axle uses {100 * used[0].max():.1f} %; what a leading axle loses in load the last gains.",
    )


def _operations(loop: Loop) -> int:
    """Operations on numbers that a step of the observer takes, as it is written here."""
    none = jnp.zeros(1)
    measured = Measurement(none, jnp.asarray(5.0), none, none)
    state = loop.observer.init(loop.nominal, measured)
    traced = jax.make_jaxpr(loop.observer.update)(state, loop.nominal, measured, none, SYSTEM.step)
    moved = {"broadcast_in_dim", "convert_element_type"}
    return sum(one.primitive.name not in moved for one in traced.eqns)


def _beyond_reach(loop: Loop) -> list[Claim]:
    cycles = 150e6 * SYSTEM.step
    return [
        judged(_PAPER, claim, ours, unit, Verdict(CANNOT_BE_CHECKED), ASSUMED, remark)
        for claim, ours, unit, remark in (
            (
                "Hardware in the loop shows the same (Fig. 18 to 21)",
                np.nan,
                "",
                "Its parameters and its figures' numbers are not printed.",
            ),
            (
                "The method runs on a signal processor TMS320F2812",
                float(_operations(loop)),
                "operations a step of the observer",
                "A processor of 150 MHz with fixed-point numbers. Neither the period of the "
                f"control nor the load of the processor is printed; a step of .1 ms is "
                f"{cycles:.0f} cycles, and in the operations there is one cube root.",
            ),
        )
    ]
