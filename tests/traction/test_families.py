"""Families of rails against closed forms, brute force, scipy and a second simulator."""

import dataclasses
import typing
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes
from scipy.integrate import solve_ivp
from scipy.stats import kstest
from second_simulator import Segments, utilisation

from adhesion_jax.effects.contact import Cleaning
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.closed_loop import by_segment, figures, whole
from adhesion_jax.traction.controllers.linearised import Barrier
from adhesion_jax.traction.families import FAMILIES
from adhesion_jax.traction.families.base import ADHESIONS, JITTER, LENGTH, SLIPS
from adhesion_jax.traction.families.changing import LENGTHS, TRANSITION
from adhesion_jax.traction.loop import run, timing
from adhesion_jax.traction.observers.full_dimension import FullDimension, TrueLoad
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.rails import ByTime, Passed, Rails, stacked
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.seekers.given import ConstantSlip, TrueOptimum
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.signals import Reference, Signals
from adhesion_jax.traction.surface import RailSurface, with_peak
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import built

STEP = 2e-4
SPEED = jnp.asarray(5.0)
NOW = jnp.zeros((), dtype=int)
DRAWS = 400

every_family = pytest.mark.parametrize("name", lanes(FAMILIES, always=5, long=len(FAMILIES)))


@cache
def keys_of(count):
    return jax.random.split(jax.random.key(3), count)


@cache
def drawn(name, count=DRAWS):
    return jax.jit(jax.vmap(lambda key: FAMILIES[name].draw(key, STEP)))(keys_of(count))


def one_of(name, number=0):
    return jax.tree.map(lambda values: values[number], drawn(name))


@cache
def hxd1f():
    """The loop of the leaderboard: sampled each millisecond, with noise."""
    system = SYSTEMS["hxd1f"]
    case = system.cases(system.step)[0]._replace(sampled=1e-3)
    loop = built(system, case, read_plant(shipped()["hxd1f"]).plant, noisy=True)
    controller = Barrier(gain=80.0, below=0.1, above=0.3, least=-0.3)
    return dataclasses.replace(loop, observer=FullDimension(-500.0), controller=controller)


@partial(jax.jit, static_argnums=2)
def computed(loop, rails, grid):
    """The figures of the segments and of the whole of runs on rails [runs]."""

    def one(rails, key):
        totals = run(dataclasses.replace(loop, rails=rails), grid, key)
        return [figures(part, grid.sample_period) for part in (by_segment(totals), whole(totals))]

    count = len(jax.tree.leaves(rails)[0])
    return jax.vmap(one)(rails, jax.random.split(jax.random.key(1), count))


def runs_of(loop, rails, duration=15.0):
    loop = jax.tree.map(lambda x: jnp.asarray(x, dtype=float), loop)
    return jax.tree.map(np.asarray, computed(loop, rails, timing(loop, STEP, 1e-3, duration)))


@every_family
def test_rails_of_a_family_are_of_one_form_and_begin_on_the_grid(name):
    family = FAMILIES[name]
    rails = drawn(name)
    assert isinstance(rails, Rails)
    alone = jax.jit(lambda key: family.draw(key, STEP))(keys_of(DRAWS)[7])
    assert jax.tree.structure(alone) == jax.tree.structure(rails)
    for one, many in zip(jax.tree.leaves(alone), jax.tree.leaves(rails), strict=True):
        np.testing.assert_allclose(one, many[7], rtol=1e-12)
    starts = np.asarray(rails.starts)
    assert starts.shape == (DRAWS, family.SEGMENTS)
    assert alone.segments == family.SEGMENTS
    assert not starts[:, 0].any()
    late = starts[:, 1:] * STEP - LENGTH * np.arange(1, family.SEGMENTS)
    assert np.abs(late).max() <= JITTER + STEP
    assert kstest(late.ravel(), "uniform", (-JITTER, 2 * JITTER)).pvalue > 1e-3


@every_family
def test_peaks_are_those_of_a_fine_grid_and_slips_log_uniform(name):
    rails = drawn(name)

    grid = np.geomspace(5e-3, 3.0, 4000)
    axles = 8 if name == "axles" else 1

    @jax.jit
    @jax.vmap
    def first(rails):
        """The surface after the transition of the first segment, at 5 m/s, its curve and peak."""
        state = rails.init(jnp.zeros(1), SPEED)
        surface = rails.present(state, NOW, jnp.asarray(20_000), SPEED)
        curve = jax.vmap(lambda v: surface(jnp.full(axles, v), SPEED)[0])(jnp.asarray(grid))
        return surface, curve, surface.peak(SPEED)

    surfaces, adhesion, peaks = first(rails)
    adhesion = np.asarray(adhesion)
    slip, largest = (np.asarray(values).reshape(DRAWS, -1)[:, 0] for values in peaks[:2])
    if name == "no-maximum":
        # It has none: the level stands for it, with the slip of 95 % of it.
        assert not np.asarray(peaks.found).any()
        assert np.all(np.diff(adhesion, axis=1) >= 0)
        np.testing.assert_allclose(adhesion[:, -1], largest, rtol=1e-9)
        at_slip = [np.interp(v, grid, row) for v, row in zip(slip, adhesion, strict=True)]
        np.testing.assert_allclose(at_slip, 0.95 * largest, rtol=1e-3)
    else:
        assert np.asarray(peaks.found).all()
        np.testing.assert_allclose(adhesion.max(axis=1), largest, rtol=1e-4)
        np.testing.assert_allclose(grid[adhesion.argmax(axis=1)], slip, rtol=0.02)
    if name == "split":
        sides = [surfaces.law.right, surfaces.law.left]
        between = np.sort([np.log(side.b / side.a) / (side.b - side.a) for side in sides], axis=0)
        assert np.all((between[0] <= slip) & (slip <= between[1]))
        assert not np.allclose(*between)
        return
    if name == "two-maxima":
        turns = np.diff(np.sign(np.diff(adhesion, axis=1)), axis=1) < 0
        assert np.all(turns.sum(axis=1) == 2)
        return
    if name == "film":
        largest = largest * (1 + np.asarray(rails.gains)[:, 0])  # once it is clean
    assert SLIPS[0] <= slip.min()
    assert slip.max() <= SLIPS[1]
    assert ADHESIONS[0] <= largest.min()
    assert largest.max() <= ADHESIONS[1]
    share = np.log(slip / SLIPS[0]) / np.log(SLIPS[1] / SLIPS[0])
    assert kstest(share, "uniform").pvalue > 1e-3
    assert kstest(largest, "uniform", (ADHESIONS[0], np.ptp(ADHESIONS))).pvalue > 1e-3


def test_a_slow_transition_passes_from_one_peak_to_the_next():
    rails = one_of("slow")
    begin = int(rails.starts[1])

    @jax.jit
    def peak_at(step):
        segment = rails.segment(step, SPEED, jnp.asarray(False))
        return rails.present((), segment, step, SPEED).peak(SPEED)

    peak_of = jax.jit(lambda number: rails.surface(number).peak(SPEED))
    before, after = map(peak_of, (0, 1))
    for seconds, share in ((-STEP, 0.0), (0.25, 0.25), (TRANSITION, 1.0), (2.0, 1.0)):
        found = peak_at(begin + round(seconds / STEP))
        for name in ("slip", "adhesion"):
            ends = float(getattr(before, name)), float(getattr(after, name))
            assert float(getattr(found, name)) == pytest.approx(
                ends[0] ** (1 - share) * ends[1] ** share, rel=1e-9
            )


def test_adhesion_falls_and_the_best_slip_rises_with_the_speed():
    rails = one_of("speed", 5)
    power = float(rails.powers[0])
    peaks = [rails.present((), NOW, NOW, jnp.asarray(v)).peak(jnp.asarray(v)) for v in (5.0, 20.0)]
    assert float(peaks[1].slip / peaks[0].slip) == pytest.approx(4)
    assert float(peaks[1].adhesion / peaks[0].adhesion) == pytest.approx(4**-power)


def test_patches_lie_by_distance_and_come_again():
    rails = one_of("patches")
    lengths = np.diff(np.asarray(rails.ends), prepend=0.0)
    assert LENGTHS[0] <= lengths.min()
    assert lengths.max() <= LENGTHS[1]
    state = rails.init(jnp.zeros(1), SPEED)
    one = jnp.zeros(1)
    state = rails.update(state, Passed(NOW, one, one, SPEED), 0.3)
    assert float(state) == pytest.approx(1.5)
    for distance in (0.0, float(rails.ends[3]) - 1e-6, float(rails.ends[3]), 1e4 / 3):
        number = int(np.searchsorted(rails.ends, distance % float(rails.ends[-1]), "right"))
        found = rails.present(jnp.asarray(distance), NOW, NOW, SPEED)
        assert found.law == rails.surface(jnp.asarray(number)).law


def test_a_film_is_cleaned_as_a_solver_cleans_it_and_followers_run_on_what_is_left():
    rails = one_of("film", 2)
    gain, work = float(rails.gains[0]), float(rails.works[0])
    law = rails.surface(NOW).law

    def slips(time):
        return np.array([0.1, 0.05]) * (1 + np.sin(3 * time))

    adhesion_at = jax.jit(lambda slips: law(slips, {}))

    def power(time, _):
        return np.cumsum(np.abs(adhesion_at(slips(time)) * slips(time)))

    solved = solve_ivp(power, (0.0, 1.0), [0.0, 0.0], rtol=1e-9, atol=1e-12).y[:, -1]
    step = 1e-3

    def update(state, time):
        slip = jnp.array([0.1, 0.05]) * (1 + jnp.sin(3 * time))
        adhesion = rails.present(state, NOW, NOW, SPEED)(slip, SPEED)
        return rails.update(state, Passed(NOW, slip, adhesion, SPEED), step), adhesion

    begin = rails.init(jnp.zeros(2), SPEED)
    times = jnp.arange(1000) * step
    state, adhesions = jax.jit(lambda: jax.lax.scan(update, begin, times))()
    np.testing.assert_allclose(state.work, solved, rtol=1e-3)
    factors = np.asarray(rails.present(state, NOW, NOW, SPEED).law.factor)
    np.testing.assert_allclose(factors, 1 + gain * (1 - np.exp(-solved / work)), rtol=1e-3)
    # The first axle is the effect `cleaning` in its form for a whole run, in slip velocity.
    slip = 0.1 * (1 + jnp.sin(3 * times))
    columns = {"time_s": times, "vehicle_speed_mps": jnp.ones(times.shape)}
    whole_run = Cleaning(gain, work, 0.0).after(law(slip, {}), slip, columns)
    np.testing.assert_allclose(adhesions[1:, 0], whole_run[1:], rtol=2e-3)
    # The next segment is as new.
    surface = rails.present(state, jnp.asarray(1), NOW, SPEED)
    np.testing.assert_array_equal(surface.law.factor, [1.0, 1.0])


@pytest.mark.parametrize("name", ["exponential", "no-maximum", "two-maxima", "film", "speed"])
def test_the_optimum_of_a_price_is_that_of_brute_force(name):
    axles, prices = 2, (1.0, 3.0)
    grid = np.geomspace(2e-3, 5.0, 20_001)

    @jax.jit
    @jax.vmap
    def optima(rails):
        """For each price, and the adhesion of all slips."""
        surface = rails.present(rails.init(jnp.zeros(axles), SPEED), NOW, NOW, SPEED)
        curve = jax.vmap(lambda v: surface(jnp.full(axles, v), SPEED))(jnp.asarray(grid))
        return [surface.best(SPEED, price, axles) for price in prices], curve

    found, curve = optima(jax.tree.map(lambda values: values[:3], drawn(name)))
    for price, best in zip(prices, found, strict=True):
        gains = np.asarray(curve) * (5.0 - price * grid)[:, None]
        largest = np.asarray(best.adhesion) * (5.0 - price * np.asarray(best.slip))
        np.testing.assert_allclose(largest, gains.max(axis=1), rtol=1e-6)
        np.testing.assert_allclose(best.slip, grid[gains.argmax(axis=1)], rtol=2e-3)


def test_nothing_of_a_rail_is_in_the_signals():
    """A seeker and a controller are given numbers alone, and the optimum only if they say so."""
    told = typing.get_type_hints(Signals)
    assert not any(
        isinstance(kind, type) and issubclass(kind, (Rails, RailSurface)) for kind in told.values()
    )
    assert {name for name in told if "rail" in name or "surface" in name} == set()
    assert ConstantSlip(0.1).told_price is None
    assert TrueOptimum(price=3.0).told_price == 3.0


class Sweeping(Seeker):
    """Raises the slip for 4 s and holds that of the largest adhesion it has seen."""

    def init(self, nominal, signals):
        return signals.adhesion, signals.slip_beside

    def update(self, state, nominal, signals, period):
        largest, slip = state
        higher = signals.adhesion > largest
        state = jnp.maximum(signals.adhesion, largest), jnp.where(higher, signals.slip_beside, slip)
        asked = jnp.where(signals.time < 4.0, 0.02 + 0.1 * signals.time, state[1])
        return state, Reference(asked, jnp.zeros_like(asked))


@pytest.mark.thorough
def test_a_seeker_with_the_true_load_and_no_noise_finds_the_analytic_peak():
    quiet = dataclasses.replace(
        hxd1f(), sensors=Sensors(period=1e-3), observer=TrueLoad(), seeker=Sweeping()
    )
    slip = 0.12
    # The second segment tells where the seeker is from 6 s on.
    same = stacked([with_peak(0.2, slip, 2.2222)] * 2)
    rails = jax.tree.map(lambda x: x[None], ByTime(same, jnp.array([0, round(4 / STEP)])))
    segments, _ = runs_of(quiet, rails, 8.0)
    assert float(segments["slip_settled"][0, 1]) == pytest.approx(slip, rel=0.01)


@pytest.mark.thorough
@pytest.mark.parametrize("method", ["true optimum", "constant"])
def test_a_second_simulator_gives_the_same_use_of_adhesion(method):
    rails = jax.tree.map(lambda values: values[:3], drawn("exponential"))
    seeker = TrueOptimum() if method == "true optimum" else ConstantSlip(0.094)
    _, found = runs_of(dataclasses.replace(hxd1f(), seeker=seeker), rails)
    for number in range(3):
        starts = np.asarray(rails.starts[number]) * STEP
        peaks = [rails.surfaces.law.peak({}, 10.0)]
        slips, tops = (np.asarray(values)[number].tolist() for values in peaks[0][:2])
        other = Segments(starts.tolist(), slips, tops)

        def asked(segment, slips=slips):
            return slips[segment] if method == "true optimum" else 0.094

        expected = utilisation(other, asked, STEP, 15.0, -500.0, 80.0, seed=number)
        assert found["utilisation"][number, 0] == pytest.approx(expected, abs=2e-3)


@pytest.mark.long
def test_eight_axles_on_rails_of_their_own_pull_what_these_hold():
    plant = read_plant(shipped()["hxd1f_axles"]).plant
    system = SYSTEMS["hxd1f"]
    case = system.cases(system.step)[0]._replace(sampled=1e-3)
    loop = dataclasses.replace(
        built(system, case, plant), observer=FullDimension(-500.0), seeker=TrueOptimum(0.0)
    )
    loop = FAMILIES["axles"].met(dataclasses.replace(loop, rails=one_of("axles")))
    known, worn = loop.nominal.wheel_radius, loop.plant.wheel_radius
    assert known.tolist() == [0.625] * 8
    assert np.abs(worn - known).max() == pytest.approx(0.004)
    # No axle can have less adhesion and all together more pull.
    largest = jax.jit(lambda rails: rails.surface(NOW).peak(SPEED).adhesion)(loop.rails)
    assert len(set(largest.tolist())) == 8
    shares = np.random.default_rng(0).uniform(0, 1, (50, 8))
    pulls = jax.jit(jax.vmap(plant.pull))(np.vstack([np.ones(8), shares]) * np.asarray(largest))
    assert np.all(pulls[1:] < pulls[0])
    # Control that knows the radii, and control that does not.
    grid = timing(loop, STEP, 1e-3, 2.0)

    @jax.jit
    def share_of(loop):
        totals = run(loop, grid, jax.random.key(0))
        return figures(whole(totals), grid.sample_period)["pull_share"][0]

    told, untold = (
        float(share_of(one)) for one in (dataclasses.replace(loop, nominal=loop.plant), loop)
    )
    assert 0.97 < told < 1
    assert untold < told - 0.01


def test_rails_of_eight_axles_refuse_a_plant_of_one():
    with pytest.raises(InputError, match=r"those of 8 axles .* has 1; give --plant hxd1f_axles\.$"):
        FAMILIES["axles"].met(hxd1f())


@pytest.mark.slow
@pytest.mark.parametrize("name", lanes(FAMILIES, 0, 0))
@pytest.mark.parametrize("price", [0, 1, 3])
def test_no_constant_slip_gains_more_than_the_true_optimum(name, price):
    if name == "no-maximum" and price == 0:
        pytest.skip("without a price the best slip on these rails has no end")
    if name == "axles":
        pytest.skip("they are rails of eight axles")
    rails = jax.tree.map(lambda values: values[:8], drawn(name))
    column = f"utility_{price}"
    loop = dataclasses.replace(hxd1f(), seeker=TrueOptimum(float(price)))
    best = runs_of(loop, rails)[1][column][:, 0]
    for slip in (0.05, 0.1, 0.2, 0.4, 0.8):
        loop = dataclasses.replace(hxd1f(), seeker=ConstantSlip(slip))
        other = runs_of(loop, rails)[1][column][:, 0]
        gap = best - other
        error = gap.std(ddof=1) / np.sqrt(len(gap))
        assert gap.mean() > -3 * error
