"""What is compared on equal terms: their numbers, identifiers as seekers, seekers of NumPy."""

import dataclasses
from operator import attrgetter
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes
from one_sample import PLANT, signals_of
from scipy.optimize import minimize_scalar

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Status
from adhesion_jax.identifiers.of_numpy import complain
from adhesion_jax.records import Record
from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.entrants import ENTRANTS, box, configured, numbers, sought
from adhesion_jax.traction.families import FAMILIES
from adhesion_jax.traction.loop import Loop, check, timing, trace
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.seekers import SEEKERS, Seeker
from adhesion_jax.traction.seekers.climbing import PerturbAndObserve
from adhesion_jax.traction.seekers.of_numpy import seeker_of_numpy
from adhesion_jax.traction.seekers.offset_curve import OffsetCurve, Sums, fits
from adhesion_jax.traction.seekers.slewed import Slewed
from adhesion_jax.traction.sensors import Sensors, SpeedNoise
from adhesion_jax.traction.signals import Reference, Signals
from adhesion_jax.traction.surface import RailSurface

STEP, PERIOD = 2e-4, 1e-3
KEY = jax.random.key(0)
CURVE = Burckhardt(0.3, 25.0, 0.6)


def adhesion_at(slip):
    return 0.3 * (1 - np.exp(-25.0 * slip)) - 0.6 * slip


def loop_of(entrant, rails):
    return Loop(
        plant=PLANT,
        nominal=PLANT,
        rails=rails,
        driver=Driver(traction=13e3),
        sensors=Sensors(SpeedNoise(0.02, 5e-3), period=PERIOD),
        observer=entrant.observer,
        seeker=entrant.seeker,
        controller=entrant.controller,
        train_speed=jnp.asarray(5.0),
        slip=jnp.zeros(1),
        slope=jnp.asarray(0.0),
    )


_trace = jax.jit(lambda loop, grid, key: trace(loop, grid, key)[1], static_argnums=1)


def run(entrant, rails, duration=0.3):
    loop = loop_of(entrant, rails)
    check(loop)
    return _trace(loop, timing(loop, STEP, PERIOD, duration), KEY)


def fed(seeker, slips, adhesions, offset=0.0):
    """The last state, and all slips asked for, of a seeker that is given these in turn."""
    first = signals_of(slips[0], adhesions[0])

    def step(state, given):
        signals = signals_of(*given)
        state, reference = seeker.update(state, PLANT, signals, PERIOD)
        return state, reference.slip

    given = (jnp.asarray(slips), jnp.asarray(adhesions) + offset)
    return jax.jit(lambda: jax.lax.scan(step, seeker.init(PLANT, first), given))()


def sweep(count=1500):
    """Slips to and fro around the peak of the curve, and its adhesions there."""
    slips = 0.1 + 0.07 * np.sin(np.arange(count) / 70)
    return slips, adhesion_at(slips)


@pytest.mark.parametrize("name", ENTRANTS)
def test_the_corners_of_the_unit_cube_are_the_ends_of_the_ranges(name):
    entrant = ENTRANTS[name]
    found = box(entrant)
    assert tuple(found) == numbers(entrant)
    for share, end in ((0.0, "low"), (1.0, "high")):
        at = configured(entrant, jnp.full(len(found), share))
        assert jax.tree.structure(at) == jax.tree.structure(entrant)
        for place, one in found.items():
            assert float(attrgetter(place)(at)) == pytest.approx(getattr(one, end)), place
    # And in between, with one number moved, all others stay.
    middle = configured(entrant, jnp.full(len(found), 0.5))
    for index, place in enumerate(found):
        moved = configured(entrant, jnp.full(len(found), 0.5).at[index].set(0.25))
        for other in found:
            same = attrgetter(other)(moved) == attrgetter(other)(middle)
            assert bool(same) == (other != place)


@pytest.mark.parametrize("name", lanes(ENTRANTS, always=1, long=2, thorough=20))
def test_every_entrant_runs(name):
    found = run(ENTRANTS[name], FAMILIES["exponential"].draw(KEY, STEP))
    assert np.isfinite(np.asarray(found.command)).all()
    assert np.isfinite(np.asarray(found.sample.adhesion)).all()


@pytest.mark.long
@pytest.mark.parametrize("name", ["varpro-offset", "ml-pooled"])
def test_an_identifier_finds_as_a_seeker_what_it_finds_alone(name):
    slips, adhesions = sweep()
    adhesions = adhesions + 1e-3 * np.random.default_rng(0).standard_normal(len(slips))
    seeker = ENTRANTS[name].seeker.seeker
    every = round(seeker.spacing / PERIOD)
    state, asked = fed(dataclasses.replace(seeker, dither=0.0), slips, adhesions)
    taken = slice(every - 1, None, every)
    blocks = (np.reshape(x[taken], (-1, seeker.block)) for x in (slips, adhesions))
    slip, adhesion = map(jnp.asarray, blocks)
    fresh = jnp.ones(slip.shape, dtype=bool)

    @jax.jit
    def alone(records):
        first = seeker.identifier.init(seeker.known, KEY)
        last = jax.lax.scan(lambda *both: (seeker.identifier.update(*both), None), first, records)
        return seeker.identifier.estimate(last[0])

    expected = alone(Record(slip, adhesion, fresh, fresh, {}))
    assert int(expected.status) == Status.TRUSTED
    np.testing.assert_allclose(asked[-1, 0], expected.values["slip_opt"], rtol=1e-9)
    peak = jax.jit(lambda state: seeker.identified(state))(state)
    np.testing.assert_allclose(peak.adhesion[0], expected.values["mu_max"], rtol=1e-9)
    place = [*expected.values].index("slip_opt")
    error = jnp.sqrt(expected.covariance[place, place])
    np.testing.assert_allclose(peak.slip_error[0], error, rtol=1e-6)


@pytest.mark.parametrize("name", lanes(["offset-curve", "varpro"], always=1, long=1))
def test_without_noise_the_peak_is_found_to_one_per_cent(name):
    seeker = ENTRANTS[name].seeker.seeker
    if isinstance(seeker, OffsetCurve):
        seeker = dataclasses.replace(seeker, price=0.0)
    state, _ = fed(seeker, *sweep())
    best = minimize_scalar(lambda slip: -adhesion_at(slip), bounds=(0.01, 0.6)).x
    assert float(state.asked[0]) == pytest.approx(best, rel=0.01)
    assert float(seeker.identified(state).slip[0]) == pytest.approx(best, rel=0.01)
    largest = adhesion_at(best)
    assert float(seeker.identified(state).adhesion[0]) == pytest.approx(largest, rel=0.01)


@pytest.mark.parametrize(
    "name", ["gradient-uyulan2018", "gradient", "perturb-and-observe", "sliding-extremum"]
)
def test_in_braking_a_seeker_asks_for_the_same_slip_with_its_sign_turned(name):
    seeker, (slips, adhesions) = SEEKERS[name], sweep(400)
    if name == "gradient-uyulan2018":
        seeker = dataclasses.replace(seeker, switch=0.25)

    def asked(way):
        def step(state, given):
            signals = jax.tree.map(lambda one: way * one, signals_of(*given))
            return seeker.update(state, PLANT, signals, PERIOD)

        first = jax.tree.map(lambda one: way * one, signals_of(slips[0], adhesions[0]))
        given = jnp.asarray(slips), jnp.asarray(adhesions)
        return jax.jit(lambda: jax.lax.scan(step, seeker.init(PLANT, first), given)[1])()

    for traction, braking in zip(asked(1.0), asked(-1.0), strict=True):
        np.testing.assert_allclose(braking, -traction, rtol=1e-9)


def test_a_young_rail_asks_for_no_less_than_half_the_start():
    """Samples of a slip that fell, which tell of a peak at .02 m/s, are followed later."""
    seeker = SEEKERS["offset-curve"]
    slips = 0.02 + 0.01 * np.sin(np.arange(600) / 20)
    adhesions = 0.3 - 400.0 * (slips - 0.02) ** 2
    _, asked = fed(dataclasses.replace(seeker, dither=0.0), slips, adhesions)
    dither = 0.004
    assert asked[:149].min() >= seeker.start / 2 - dither
    assert asked[-1] < seeker.start / 2 - dither


def test_an_offset_of_adhesion_hardly_moves_the_peak():
    seeker = dataclasses.replace(SEEKERS["offset-curve"], price=0.0)
    without, with_it = (fed(seeker, *sweep(), offset=offset)[0] for offset in (0.0, 0.02))
    assert float(with_it.asked[0]) == pytest.approx(float(without.asked[0]), rel=0.03)


def test_a_price_asks_for_the_slip_that_is_worth_most():
    state, _ = fed(dataclasses.replace(SEEKERS["offset-curve"], price=10.0), *sweep())
    worth = lambda slip: -adhesion_at(slip) * (5.0 - 10.0 * slip)  # noqa: E731
    best = minimize_scalar(worth, bounds=(0.01, 0.6)).x
    assert best < 0.09
    assert float(state.asked[0]) == pytest.approx(best, rel=0.02)


def test_the_curves_of_all_steepnesses_are_those_of_least_squares():
    slips, adhesions = sweep(300)
    steep = np.geomspace(2.0, 120.0, 48)
    left = np.exp(-steep[:, None] * slips)
    sums = Sums(
        *(np.sum(x, axis=-1)[None] for x in (left, left**2, left * slips, left * adhesions)),
        *(
            np.sum(x)[None, None]
            for x in (
                *(np.ones(300), slips, slips**2),
                *(adhesions, slips * adhesions, adhesions**2),
            )
        ),
    )
    x, inverse, squares = jax.jit(fits)(sums)
    for place in (10, 25, 40):
        rows = np.stack([np.ones(300), -left[place], -slips], axis=1)
        rows = np.vstack([rows, [0.1, -0.1, 0.0]])  # mu(0) = 0 with a hundredth of the weight
        expected, residual, *_ = np.linalg.lstsq(rows, np.append(adhesions, 0.0), rcond=None)
        np.testing.assert_allclose(x[0, place], expected, rtol=1e-4)
        np.testing.assert_allclose(squares[0, place], residual[0], rtol=1e-2, atol=1e-9)
        np.testing.assert_allclose(inverse[0, place], np.linalg.inv(rows.T @ rows), rtol=1e-4)


class Failing(NamedTuple):
    """An identifier that finds nothing but NaN, in the place of another."""

    RESETS = True

    def init(self, known, key):
        return IDENTIFIERS["varpro-forgetting"].init(known, key)

    def update(self, state, record):
        return state

    def estimate(self, state):
        found = IDENTIFIERS["varpro-forgetting"].estimate(state)
        values = jax.tree.map(lambda x: x * jnp.nan, found.values)
        return found._replace(values=values, status=jnp.int32(Status.NOT_FINITE))


def test_a_method_that_finds_nan_holds_its_slip():
    seeker = ENTRANTS["varpro"].seeker.seeker
    object.__setattr__(seeker := dataclasses.replace(seeker, dither=0.0), "identifier", Failing())
    state, asked = fed(seeker, *sweep(300))
    np.testing.assert_allclose(asked, 0.1)
    assert np.isnan(seeker.identified(state).slip).all()


def switched(second):
    """A rail up to .15 s, and another after it."""
    surfaces = [RailSurface(Burckhardt(*one)) for one in ((0.3, 25.0, 0.6), second)]
    return by_time(surfaces, [0.0, 0.15], STEP)


@pytest.mark.parametrize("name", lanes(["true-optimum", "offset-curve"], always=1, long=1))
def test_a_rail_that_is_swapped_changes_nothing_before_its_samples(name):
    entrant = ENTRANTS[name]
    one, other = (run(entrant, switched(c)) for c in ((0.2, 60.0, 0.4), (0.2, 15.0, 0.2)))
    asked = [np.asarray(found.sample.asked)[1:, 0] for found in (one, other)]  # NaN at first
    apart = 1 + np.flatnonzero(asked[0] != asked[1])[0]
    # A row holds what was asked for at the sample before it. Who sees the rail itself differs with
    # the switch; the first speed that tells of it is measured a sample later.
    if name == "true-optimum":
        assert apart == 151
    else:
        assert apart >= 152
    assert not set(Signals._fields) & {"rails", "rail", "surface", "state", "largest"}


def test_slew_and_bounds_hold_whatever_is_asked_for():
    class Wild(Seeker):
        def update(self, state, nominal, signals, period):
            wild = 3.0 * jnp.sin(1e4 * signals.slip) * signals.direction
            return state, Reference(wild, jnp.zeros_like(wild))

    slips = np.random.default_rng(1).uniform(0, 1, 400)
    _, asked = fed(Slewed(Wild(), start=0.1, rate=2.0, lowest=0.02, highest=0.5), slips, slips)
    moves = np.diff(np.asarray(asked)[:, 0], prepend=0.1)
    assert np.abs(moves).max() <= 2.0 * PERIOD * (1 + 1e-9)
    assert asked.min() >= 0.02 - 1e-12
    assert asked.max() <= 0.5 + 1e-12


def test_the_sliding_seeker_asks_for_its_slip_behind_a_critically_damped_tracker():
    seeker = dataclasses.replace(SEEKERS["sliding-extremum"], rise=0.0)  # so that v* stays
    signals = signals_of(0.1, 0.2)
    state = seeker.init(PLANT, signals)._replace(asked=jnp.full(1, 0.31))
    for _ in range(25):
        state, asked = seeker.update(state, PLANT, signals, PERIOD)
    turned = 60.0 * 25 * PERIOD
    left = 0.3 * np.exp(-turned)
    np.testing.assert_allclose(asked.slip, 0.31 - (1 + turned) * left, rtol=1e-12)
    np.testing.assert_allclose(asked.rate, 60.0 * turned * left, rtol=1e-12)


def test_perturb_and_observe_climbs_and_stays():
    """On the curve itself, with the slip that it asks for one sample later."""
    seeker = PerturbAndObserve(step=0.004, window=0.01, start=0.03, lowest=0.01, highest=0.6)

    def step(carry, _):
        state, slip = carry
        signals = signals_of(slip, CURVE(slip, {}))
        state, reference = seeker.update(state, PLANT, signals, PERIOD)
        return (state, reference.slip), reference.slip

    start = jnp.full(1, 0.03)
    first = seeker.init(PLANT, signals_of(start, CURVE(start, {})))
    asked = jax.lax.scan(step, (first, start), None, length=1000)[1]
    best = float(CURVE.peak({}).slip)
    assert np.abs(np.asarray(asked[600:]) - best).max() < 3 * 0.004


class Follower(Seeker):
    """A share of the slip that is observed, and a mean of the adhesion."""

    def init(self, nominal, signals):
        return 0.1 * jnp.ones_like(signals.slip), jnp.zeros_like(signals.slip)

    def update(self, state, nominal, signals, period):
        asked, mean = state
        mean = mean + 0.1 * (signals.adhesion - mean)
        asked = asked + period * (mean - 0.2) * signals.direction
        return (asked, mean), Reference(asked, jnp.zeros_like(asked))


class InNumpy:
    def init(self):
        return {"asked": np.full(1, 0.1), "mean": np.zeros(1)}

    def update(self, state, signals, period):
        mean = state["mean"] + 0.1 * (signals.adhesion - state["mean"])
        asked = state["asked"] + period * (mean - 0.2) * signals.direction
        return {"asked": asked, "mean": mean}, asked


@pytest.mark.long
def test_a_seeker_of_numpy_asks_for_what_its_twin_asks_for():
    rails = FAMILIES["exponential"].draw(KEY, STEP)
    twins = (Follower(), seeker_of_numpy("mine", InNumpy))
    one, other = (run(sought(seeker), rails, 0.1).sample for seeker in twins)
    complain()
    np.testing.assert_allclose(one.asked, other.asked, rtol=1e-9)
    assert float(jnp.std(one.asked[5:])) > 0


def test_a_seeker_of_numpy_that_fails_is_told_in_a_sentence():
    class Wrong(InNumpy):
        def update(self, state, signals, period):
            return state, signals.rail

    found = run(
        sought(seeker_of_numpy("mine", Wrong())), FAMILIES["exponential"].draw(KEY, STEP), 0.01
    )
    assert np.isnan(np.asarray(found.sample.asked)[-1]).all()
    with pytest.raises(InputError, match=r"mine cannot be used as a method: it raises Attr.* line"):
        complain()
    with pytest.raises(InputError, match="mine is no seeker: it lacks init and update"):
        seeker_of_numpy("mine", 3)


def test_whole_laws_have_no_seeker_and_others_have_the_same_terms():
    for entrant in ENTRANTS.values():
        assert (entrant.seeker is not None) == entrant.controller.FOLLOWS
        if entrant.controller == CONTROLLERS["barrier"]:
            terms = [float(getattr(entrant.seeker, name)) for name in ("start", "rate", "lowest")]
            assert terms == [0.1, 2.0, 0.01]
            assert type(entrant.observer) is type(OBSERVERS["full-dimension"])
