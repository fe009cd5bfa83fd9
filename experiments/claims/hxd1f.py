"""The HXD1F of 2019: extremum seeking with a sliding mode and a barrier controller.

The tables of the paper are lost in the text at hand, so that almost every number is ours: its
claims are judged over settings.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.traction.controllers.linearised import SlidingMode
from adhesion_jax.traction.controllers.readhesion import DifferentialAcceleration
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.observers import Observer
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.signals import Measurement
from adhesion_jax.traction.surface import with_peak
from adhesion_jax.traction.systems.base import built
from adhesion_jax.traction.systems.hxd1f import STARTS, SURFACES, SYSTEM
from experiments.claims.claim import Claim, Flags, Numbers, Setting, read_paper, values
from experiments.claims.traction import (
    Found,
    Runs,
    changed,
    numbers_of,
    on_plant,
    plant_of,
    runs_of,
    with_numbers,
)

PAPER = read_paper("hxd1f")

#: The time after which the observer tracks adhesion, s.
_OBSERVED = PAPER.claims["observer_time"]["printed"]

#: "Good" use of a rail is read as this share of the largest adhesion, at least.
_GOOD = 0.9

#: Lags of the torque in s, and upper ends of the interval of the barrier in m/s.
_INTERVALS = ((2e-4, 0.05), (1e-2, 0.20), (1e-2, 0.22))

#: The load that the observers are to find, N m.
LOAD = 3000.0


def hxd1f_claims(progress: Callable[[str], None]) -> Found:
    """Each form of the loop at our own setting, then at those drawn."""
    run = partial(runs_of, SYSTEM, (*SURFACES,), progress)
    settings = PAPER.settings()
    plain = [_loop(setting) for setting in settings]
    pairs = [*zip(plain, settings, strict=True)]
    layered = _sliding(*pairs[0], layer=0.05)
    seeking, narrow = run("HXD1F 2019", plain, [_narrow(plain[0], *ends) for ends in _INTERVALS])
    (sampled,) = run("HXD1F 2019, speed held", [_sampled(loop) for loop in plain])
    slow = [changed(loop, observer=_full_dimension(setting)) for loop, setting in pairs]
    (lagging,) = run("HXD1F 2019, full dimension", slow)
    other = [_differential(*pair) for pair in pairs]
    (differential,) = run("HXD1F 2019, differential acceleration", other)
    by_sign, by_layer = run(
        "HXD1F 2019, sliding mode", [_sliding(*pair) for pair in pairs], [layered]
    )
    (axles,) = run("HXD1F 2019, axles of their own", [_own_axles(loop) for loop in plain])
    chosen = _either(seeking, sampled, values(settings, "sampling") >= 0.5)
    claims = [
        *_observers(plain, settings, seeking, lagging),
        _at_the_switches(chosen),
        *_search_times(chosen, seeking, sampled),
        _snow(chosen),
        _neighbourhood(settings),
        *_against_differential(seeking, differential),
        *_against_sliding(seeking, by_sign, by_layer),
        _interval(seeking, narrow, settings),
        _no_skid(chosen),
        _each_axle(axles),
        PAPER.judged("hardware"),
        PAPER.judged("processor", _operations(plain[0]), cycles=150e6 * SYSTEM.step),
    ]
    used, found = 100 * chosen.figure("utilisation", "dry"), chosen.figure("t95", "dry") <= 1.0
    return Found(PAPER, settings, claims, used, found)


def _loop(setting: Setting) -> Loop:
    """The paper's own method at a setting, on a speed that is not sampled."""
    plant = changed(plant_of(SYSTEM), **numbers_of(setting, "plant"))
    load = plant.load_of(setting["dry"] * jnp.ones(1))[0]
    plant = changed(plant, torque_limit=setting["torque_over_dry"] * load)
    slips = {"dry": 0.2, "wet": 0.08, "snow": setting["snow_slip"]}
    surfaces = [with_peak(setting[name], slip, setting["curve"]) for name, slip in slips.items()]
    own = SYSTEM.cases(SYSTEM.step)[0]
    loop = built(SYSTEM, own._replace(rails=by_time(surfaces, STARTS, SYSTEM.step)), plant)
    loop = with_numbers(loop, setting, "observer", "seeker", "controller")
    driver = changed(loop.driver, traction=plant.torque_limit)
    return changed(loop, driver=driver, train_speed=jnp.asarray(setting["train_speed"]))


def _sampled(loop: Loop) -> Loop:
    return changed(loop, sensors=changed(loop.sensors, period=1e-3))


def _full_dimension(setting: Setting) -> FullDimension:
    return FullDimension(jnp.asarray(setting["pole"]))


def _narrow(loop: Loop, lag: float, above: float) -> Loop:
    controller = changed(loop.controller, above=jnp.asarray(above))
    return changed(on_plant(loop, torque_lag=jnp.asarray(lag)), controller=controller)


def _differential(loop: Loop, setting: Setting) -> Loop:
    numbers = numbers_of(setting, "differential")
    controller = DifferentialAcceleration(**numbers, least=jnp.asarray(-0.15))
    return changed(loop, seeker=None, controller=controller)


def _sliding(loop: Loop, setting: Setting, layer: float = 0.0) -> Loop:
    numbers = numbers_of(setting, "sliding")
    return changed(loop, controller=SlidingMode(**numbers, layer=jnp.asarray(layer)))


def _own_axles(loop: Loop) -> Loop:
    """Two units of four axles, each axle with its own load and its own control."""
    plant = read_plant(shipped()["hxd1f_axles"]).plant
    known = (*numbers_of(PAPER.settings()[0], "plant"), "torque_limit")
    plant = changed(plant, **{name: getattr(loop.plant, name) for name in known})
    return changed(loop, plant=plant, nominal=plant, slip=jnp.zeros_like(plant.radius))


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
) -> Iterator[Claim]:
    plants = [loop.nominal for loop in loops]
    sliding, left = settling([loop.observer for loop in loops], plants)
    double, _ = settling([_full_dimension(setting) for setting in settings], plants)
    faster, slower = (100 * float(runs.figure("utilisation", "wet")[0]) for runs in (seeking, slow))
    yield PAPER.over_settings("observer_time", sliding, sliding <= _OBSERVED)
    yield PAPER.over_settings("observer_error", 100 * left, left < 1e-3)
    facts = {"double": double[0], "pole": -5.83 / sliding[0], "slower": slower, "faster": faster}
    yield PAPER.over_settings("observer_faster", sliding, sliding < double, **facts)


def _either(seeking: Runs, sampled: Runs, held: Flags) -> Runs:
    """Of an unsampled and of a sampled speed, the run of each setting under what it has."""

    def chosen(own: Numbers, other: Numbers) -> Numbers:
        return np.where(held.reshape(-1, *(own.ndim - 1) * [1]), other, own)

    figures, trace = jax.tree.map(chosen, seeking[1:], sampled[1:])
    return Runs(seeking.segments, figures, trace)


def _at_the_switches(runs: Runs) -> Claim:
    time = runs.time
    error = np.abs(runs.axle("observed") - runs.axle("adhesion"))
    after = [(time > start + _OBSERVED) & (time < start + _OBSERVED + 0.5) for start in STARTS[1:]]
    largest = [runs.axle("largest")[:, moments].max(axis=1) for moments in after]
    rms = [np.sqrt(np.mean(error[:, moments] ** 2, axis=1)) for moments in after]
    ours = 100 * np.max(np.array(rms) / np.array(largest), axis=0)
    return PAPER.over_settings("switches", ours, ours < 5.0)


def _search_times(runs: Runs, seeking: Runs, sampled: Runs) -> Iterator[Claim]:
    for surface, printed in (("dry", 1.0), ("wet", 0.8)):
        ours, kept = runs.figure("t95", surface), 100 * runs.figure("utilisation", surface)
        times = [each.figure("t95", surface)[1:] for each in (seeking, sampled)]
        facts = {"surface": surface, "kept": kept[0], "median": np.median(kept)}
        facts |= {"printed": printed, "shares": [100 * np.mean(one <= printed) for one in times]}
        yield PAPER.over_settings("search", ours, ours <= printed, **facts)


def _snow(runs: Runs) -> Claim:
    used = runs.figure("utilisation", "snow")
    facts = {"good": _GOOD, "median": 100 * np.median(used)}
    return PAPER.over_settings("snow", 100 * used, used >= _GOOD, **facts)


def _neighbourhood(settings: Sequence[Setting]) -> Claim:
    """Slips about the peak at which k |dmu/dv_s| < rho, and the seeker does not slide."""

    def steep(largest: float, best: float, one: Setting) -> tuple[float, bool]:
        """How far below the peak it is steep enough, in m/s, and whether it is beyond the peak."""
        slips = jnp.linspace(1e-4, 6 * best, 60_000)
        law = with_peak(largest, best, one["curve"])
        slope = np.abs(np.asarray(jax.vmap(jax.grad(law))(slips, jnp.full_like(slips, 5.0))))
        enough = slope > one["seeker.rise"] / one["seeker.speed"]
        left, right = (np.asarray(slips)[enough & side] for side in (slips < best, slips > best))
        return best - (float(left.max()) if len(left) else 0.0), len(right) > 0

    slips = {"dry": 0.2, "wet": 0.08, "snow": None}
    found = {
        name: [steep(one[name], slip or one["snow_slip"], one) for one in settings]
        for name, slip in slips.items()
    }
    facts: dict[str, object] = {name: band for name, ((band, _), *_) in found.items()}
    beyond = np.array([[right for _, right in rows] for rows in found.values()])
    facts["where"] = "somewhere" if beyond[:, 0].any() else "nowhere"
    facts["beyond"] = 100 * np.mean(beyond[:, 1:].any(axis=0))
    share = np.array([band for band, _ in found["dry"]]) / 0.2
    return PAPER.over_settings("neighbourhood", 100 * share, share < 0.5, **facts)


def _against_differential(seeking: Runs, differential: Runs) -> Iterator[Claim]:
    both = (seeking, differential)
    at = (seeking.time > 2) & (seeking.time < 5)
    swings = [runs.axle("slip")[:, at].std(axis=1) for runs in both]
    yield PAPER.over_settings("swings", swings[1] / swings[0], swings[1] > swings[0], swings=swings)
    sought, reached = (np.nan_to_num(runs.figure("t95", "dry"), nan=np.inf) for runs in both)
    facts = {"reached": _when(reached[0]), "sought": _when(sought[0])}
    start = 100 * differential.figure("utilisation", "dry")
    yield PAPER.over_settings("slow_start", start, reached > sought, **facts)
    used, other = (100 * runs.figure("utilisation")[0] for runs in both)
    pull = [np.asarray(runs.trace.sample.pull).mean(axis=1) for runs in both]
    yield PAPER.over_settings(
        "traction", pull[0] / pull[1], pull[0] > pull[1], used=used, other=other
    )


def _when(time: float) -> str:
    return f"does so after {time:.2f} s" if np.isfinite(time) else "never does"


def _against_sliding(seeking: Runs, sign: Runs, layer: Runs) -> Iterator[Claim]:
    varied = [runs.figure("torque_variation", "dry") for runs in (seeking, sign, layer)]
    yield PAPER.over_settings(
        "smoother", varied[1] / varied[0], varied[1] > varied[0], varied=varied
    )
    lost = [runs.figure("slip_energy_share") for runs in (seeking, sign)]
    facts = {"barrier": 100 * lost[0][0], "sign": 100 * lost[1][0]}
    yield PAPER.over_settings("loss", lost[1] / lost[0], lost[1] > lost[0], **facts)


def _largest_error(runs: Runs) -> Numbers:
    return np.max((runs.axle("slip") - runs.axle("asked"))[:, 1:], axis=1)


def _interval(seeking: Runs, narrow: Runs, settings: Sequence[Setting]) -> Claim:
    """Theorem 7 is about a torque without lag; with one the interval must be wide enough."""
    above = values(settings, "controller.above")
    ours = _largest_error(seeking)
    quick, *slow = _largest_error(narrow)
    told = ", ".join(
        f"{limit:g} m/s: {error:.3f}"
        for (_, limit), error in zip(_INTERVALS[1:], slow, strict=True)
    )
    facts = {"above": above[0], "quick": quick, "told": told}
    return PAPER.over_settings("interval", ours, ours < above, **facts)


def _no_skid(runs: Runs) -> Claim:
    """The longest stretch beyond twice the best slip, s."""
    slip, best = np.abs(runs.axle("slip")), np.abs(runs.axle("optimum"))
    count, most = np.zeros(len(slip)), np.zeros(len(slip))
    for moment in (slip > 2 * best).T:
        count = np.where(moment, count + 1, 0)
        most = np.maximum(most, count)
    ours = most * (runs.time[1] - runs.time[0])
    facts = {"slip": runs.axle("slip")[0].max(), "furthest": np.max(slip / best, axis=1)[0]}
    briefly = 100 * np.mean(ours[1:] < 1.0)
    return PAPER.over_settings("skid", ours, ours == 0.0, briefly=briefly, **facts)


def _each_axle(axles: Runs) -> Claim:
    sample = axles.trace.sample
    used = np.mean(np.asarray(sample.adhesion) / np.asarray(sample.largest), axis=1)
    worst, facts = used.min(axis=1), {"good": _GOOD, "best": 100 * used[0].max()}
    return PAPER.over_settings("axles", 100 * worst, worst >= _GOOD, **facts)


def _operations(loop: Loop) -> int:
    """Operations on numbers that a step of the observer takes, as it is written here."""
    none = jnp.zeros(1)
    measured = Measurement(none, jnp.asarray(5.0), none, none)
    state = loop.observer.init(loop.nominal, measured)
    traced = jax.make_jaxpr(loop.observer.update)(state, loop.nominal, measured, none, SYSTEM.step)
    moved = {"broadcast_in_dim", "convert_element_type"}
    return sum(one.primitive.name not in moved for one in traced.eqns)
