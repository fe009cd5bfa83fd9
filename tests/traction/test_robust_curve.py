"""What `robust-curve` makes of swings: their band, the torque that is late, v*, and the loop."""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from one_sample import PLANT, signals_of

from adhesion_jax.campaign.loops import figures_of
from adhesion_jax.leaderboard.disturbances import disturbances
from adhesion_jax.leaderboard.judging import keys_of
from adhesion_jax.leaderboard.terms import SAMPLED, Grid, timing_of
from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.controllers.anticipating import Anticipating
from adhesion_jax.traction.entrants import ENTRANTS
from adhesion_jax.traction.filters import Swing
from adhesion_jax.traction.loop import run
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.seekers import SEEKERS
from adhesion_jax.traction.seekers.offset_curve import OffsetCurve
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import terms_of

SEEKER, CONTROLLER = SEEKERS["robust-curve"], CONTROLLERS["anticipating"]
PERIOD = 1e-3
STILL = Swing.still(jnp.zeros(1))


@pytest.mark.parametrize("frequency", [3.0, 30.0, 45.0, 70.0, 200.0])
def test_the_band_has_the_frequency_response_of_its_two_lags(frequency):
    """3 (L(3.75 ms) - L(7.5 ms)), L(T) = (1 - a)/(1 - a/z), a = exp(-period/T), beside a level."""
    turn = 2 * np.pi * frequency * PERIOD
    phase = turn * np.arange(2000)

    def lag(time):
        left = np.exp(-PERIOD / time)
        return (1 - left) / (1 - left * np.exp(-1j * turn))

    def step(swing, signal):
        swing = swing.after(signal, PERIOD)
        return swing, (swing.band[0], swing.energy[0], swing.strength(0.0)[0])

    response = 3 * (lag(0.00375) - lag(0.0075))
    # So large that its root mean square is .4 of the level.
    size = 0.4 * 7.0 * np.sqrt(2) / abs(response)
    given = jnp.asarray(7.0 + size * np.sin(phase))[:, None]
    _, (band, energy, strength) = jax.lax.scan(step, STILL, given)
    expected = size * np.imag(response * np.exp(1j * phase))
    np.testing.assert_allclose(band[-1000:], expected[-1000:], atol=1e-9 * size)
    if frequency == 30.0:
        assert abs(response) == pytest.approx(1.0, abs=0.03)
        np.testing.assert_allclose(np.mean(energy[-1000:]), (0.4 * 7.0) ** 2, rtol=1e-3)
        assert float(np.mean(strength[-1000:])) == pytest.approx(0.5, abs=0.01)


def test_a_level_is_reached_in_fifty_milliseconds_and_a_swing_fades_in_a_hundred():
    swing = STILL
    for _ in range(50):
        swing = swing.after(jnp.ones(1), PERIOD)
    assert float(swing.level[0]) == pytest.approx(1 - np.exp(-1))
    # A signal that stands where both lags are has no band, and what swung before is forgotten.
    swing = Swing(*(jnp.ones(1) for _ in STILL))
    for _ in range(100):
        swing = swing.after(jnp.ones(1), PERIOD)
    assert float(swing.energy[0]) == pytest.approx(np.exp(-1))


def test_a_swing_is_weighed_against_the_least_level():
    swing = Swing(*(jnp.asarray([one]) for one in (0.0, 0.0, -2.0, 1.44)))
    # E/(.4 level)^2 is 2.25 at the level of 2, .5625 at one of 4; x^2/(1 + x^2).
    assert float(swing.strength(1.0)[0]) == pytest.approx(2.25**2 / (1 + 2.25**2))
    assert float(swing.strength(4.0)[0]) == pytest.approx(0.5625**2 / (1 + 0.5625**2))


def commanded(dead, swing):
    """Commands to a drive with a lag of 10 ms and a dead time, where the load swings at 30 Hz."""
    phase = 2 * np.pi * 30 * PERIOD * np.arange(2000)

    def step(before, adhesion):
        state, waiting, torque = before
        signals = signals_of(0.1, adhesion, torque)
        state, command = CONTROLLER.update(state, PLANT, signals, PERIOD)
        waiting = jnp.concatenate([waiting, command])
        torque = torque - jnp.expm1(-PERIOD / 0.01) * (waiting[0] - torque)
        return (state, waiting[1:], torque), command[0]

    # The delay is known well: it is not what is tested.
    sure = jnp.full(1, 1e12)
    state = CONTROLLER.init(PLANT, signals_of(0, 0, 0))
    state = state._replace(moved=sure, asked=(0.01 + dead * PERIOD) * sure)
    first = state, jnp.zeros(dead), jnp.zeros(())
    _, found = jax.lax.scan(step, first, jnp.asarray(0.1 + swing * np.sin(phase)))
    return np.asarray(found)[-1000:]


def amplitude(signal):
    """At 30 Hz, over whole turns."""
    return 2 * abs(np.mean(signal * np.exp(-2j * np.pi * 30 * PERIOD * np.arange(signal.size))))


def test_a_strong_swing_is_taken_out_of_a_torque_that_is_late_and_of_no_other():
    """A law that is linear commands ten times as much for ten times the swing."""
    weak, strong = (amplitude(commanded(0, swing)) for swing in (0.01, 0.1))
    assert strong == pytest.approx(10 * weak, rel=1e-4)
    weak, strong = (amplitude(commanded(10, swing)) for swing in (0.01, 0.1))
    assert strong < 0.15 * 10 * weak
    load = PLANT.load_of(jnp.full(1, 0.1))[0]
    np.testing.assert_allclose(commanded(10, 0.1).mean(), load, rtol=2e-3)


def test_half_of_a_swing_is_taken_out_where_the_drive_is_five_milliseconds_late():
    """As strong as it is against a tenth of the largest torque, where the level is less."""
    signals, sure = signals_of(0.1, 0.1, 500.0), jnp.full(1, 1e12)
    known = float(PLANT.torque_lag + PLANT.dead_time)
    state = CONTROLLER.init(PLANT, signals)._replace(moved=sure, asked=(known + 0.005) * sure)
    wanted = []
    for band in (0.0, 300.0):
        swing = STILL._replace(fast=jnp.full(1, band), energy=jnp.full(1, 3e5))
        after, torque = commanding(state._replace(swing=swing), signals)
        strong = after.swing.energy[0] / (0.4 * 0.1 * PLANT.torque_limit) ** 2
        assert abs(float(after.swing.level[0])) < 0.1 * float(PLANT.torque_limit)
        taken = 0.5 * strong**2 / (1 + strong**2) * after.swing.band[0]
        wanted.append(float(torque[0] + taken))
    assert float(after.swing.band[0]) > 500
    assert wanted[1] == pytest.approx(wanted[0], rel=1e-6)


first_of_seeker = cache(jax.jit(lambda: SEEKER.init(PLANT, signals_of(0.1, 0.0))))
sampled = jax.jit(lambda state, signals: SEEKER.update(state, PLANT, signals, PERIOD)[0])
commanding = jax.jit(lambda state, signals: CONTROLLER.update(state, PLANT, signals, PERIOD))


def judged(**state):
    """The state of the seeker a period later, on a sample that lies on its curve of no adhesion."""
    whole = first_of_seeker()
    curve = whole.curve._replace(since=jnp.full(1, state.pop("since", 1.0)))
    state = {name: jnp.full(1, one) for name, one in state.items()}
    before = {name: state.pop(name) for name in ("known", "asked", "furthest") if name in state}
    swing = STILL._replace(energy=state.pop("energy", jnp.zeros(1)))
    whole = whole._replace(
        curve=curve, swing=swing, before=whole.before._replace(**before), **state
    )
    return sampled(whole, signals_of(0.1, 0.0))


def test_a_ceiling_rises_within_twenty_seconds_and_is_set_fifteen_per_cent_below():
    assert float(judged(ceiling=0.1).ceiling[0]) == pytest.approx(0.1 + 0.1 * PERIOD / 20, rel=1e-9)
    broke_away = judged(since=0.1495, known=True, asked=0.1, furthest=0.3)
    assert float(broke_away.ceiling[0]) == pytest.approx(0.085)
    stayed = judged(since=0.1495, known=True, asked=0.1, furthest=0.15)
    assert np.isinf(stayed.ceiling[0])


def test_a_swing_counts_from_twelve_thousandths_of_adhesion_on_and_stops_learning_after_a_tenth():
    one_period = np.exp(PERIOD / 0.1)  # in which an energy fades
    strong, weak = (one * one_period for one in (0.0122**2, 0.0118**2))
    assert float(judged(energy=strong, rings=0.05).rings[0]) == pytest.approx(0.051)
    assert float(judged(energy=weak, rings=0.05).rings[0]) == 0
    assert float(judged(energy=strong, rings=0.0985, since=0.05).curve.since[0]) > 0.05
    assert float(judged(energy=strong, rings=0.0995, since=0.05).curve.since[0]) == 0


@pytest.mark.long
def test_braking_is_traction_with_all_signs_turned():
    rng = np.random.default_rng(5)
    count = 400
    slips = 0.1 + 0.05 * np.sin(np.arange(count) / 20) + 0.01 * rng.normal(size=count)
    swings = 0.2 * np.sin(2 * np.pi * 30 * PERIOD * np.arange(count)) * (np.arange(count) > 200)
    adhesions = 0.3 * (1 - np.exp(-25 * slips)) - 0.6 * slips + swings
    torques = 8e3 + 500 * rng.normal(size=count)

    def turned(signals):
        return jax.tree.map(lambda one: -one, signals)

    def both(sign):
        def step(before, given):
            signals = signals_of(*given)
            seeking, controlling = before
            seeking, asked = SEEKER.update(seeking, PLANT, sign(signals), PERIOD)
            signals = sign(signals)._replace(reference=asked)
            controlling, torque = CONTROLLER.update(controlling, PLANT, signals, PERIOD)
            return (seeking, controlling), (asked.slip[0], torque[0])

        first = sign(signals_of(0.1, 0.2, 0.0))
        start = SEEKER.init(PLANT, first), CONTROLLER.init(PLANT, first)
        given = tuple(map(jnp.asarray, (slips, adhesions, torques)))
        return jax.jit(lambda: jax.lax.scan(step, start, given))()

    (state, _), traction = both(lambda signals: signals)
    _, braking = both(turned)
    assert float(state.rings[0]) > 0
    for one, other in zip(traction, braking, strict=True):
        np.testing.assert_allclose(other, -one, rtol=1e-9)


def sought(swing):
    """v* and how long nothing was learned, on a rising curve that swings after a second."""

    def step(state, number):
        time = PERIOD * number
        slip = state.curve.asked[0] + 0.01 * jnp.sin(2 * jnp.pi * 2 * time)
        on_curve = 0.3 * (1 - jnp.exp(-8 * slip))
        swings = swing * jnp.sin(2 * jnp.pi * 30 * time) * (time > 0.5)
        state, _ = SEEKER.update(state, PLANT, signals_of(slip, on_curve + swings, 0.0), PERIOD)
        return state, (state.curve.asked[0], state.rings[0], state.curve.since[0])

    first = SEEKER.init(PLANT, signals_of(0.1, 0.1, 0.0))
    _, found = jax.jit(lambda: jax.lax.scan(step, first, jnp.arange(1500)))()
    return map(np.asarray, found)


def test_v_does_not_rise_and_nothing_is_learned_while_an_axle_chatters():
    asked, rings, since = sought(0.15)
    chatters = rings[1:] > 0
    assert chatters.sum() > 700
    assert (np.diff(asked)[chatters] <= 0).all()
    # The clock of the change that the chatter seemed to be stands still.
    assert (since[rings > 0.15] == 0).all()
    calm, rings, since = sought(0.0)
    assert rings[-1] == 0
    assert since[-1] > 1.0
    assert calm[-1] > 1.1 * asked[-1]


@pytest.mark.parametrize(("misfit", "kept"), [(0.0, True), (0.1, False)])
def test_a_ceiling_stays_until_the_rail_is_another(misfit, kept):
    signals = signals_of(0.1, 0.2, 0.0)
    state = SEEKER.init(PLANT, signals)
    doubted = state.before._replace(known=jnp.ones(1, dtype=bool), worst=jnp.full(1, misfit**2))
    level = doubted.curve._replace(level=jnp.full((1, 1), 0.2))
    state = state._replace(
        curve=state.curve._replace(since=jnp.full(1, 0.1495)),
        before=doubted._replace(curve=level, asked=jnp.full(1, 0.1)),
        ceiling=jnp.full(1, 0.08),
    )
    state = sampled(state, signals)
    expected = 0.08 * (1 + PERIOD / 20) if kept else np.inf
    assert float(state.ceiling[0]) == pytest.approx(expected)


@pytest.mark.thorough
def test_an_axle_that_twists_behind_a_late_torque_does_not_break_it():
    """With the numbers of the board. Without the steps above these runs use .73 of the adhesion,
    the two worst .04 and .18; as small errors grow in such a run, none is held to a number."""
    entrant = ENTRANTS["robust-curve"]._replace(
        observer=FullDimension(-313.0), controller=Anticipating(gain=107.0, share=1.75, least=-0.3)
    )
    curve = OffsetCurve(price=1.0, memory=0.68, threshold=0.00514, dither=0.0943, start=0.1)
    entrant = eqx.tree_at(lambda one: one.seeker.seeker.curve, entrant, curve)
    family = disturbances()["twist-30Hz-dead-10ms"].disturbance
    terms = terms_of(SYSTEMS["hxd1f"], PLANT, Sensors(SYSTEMS["hxd1f"].noise, period=SAMPLED))
    timing = timing_of(terms, Grid(), "robust-curve", entrant, family)

    @jax.jit
    def judged(keys):
        def one(key):
            of_rails, of_noise = jax.random.split(key)
            loop = family.met(terms.loop(entrant, family.draw(of_rails, timing.step)))
            return figures_of(run(loop, timing, of_noise), timing)

        return jax.vmap(one)(keys)

    found = judged(keys_of(0, "exponential", np.arange(24)))
    used = np.sort(found["utilisation"][:, -1])
    assert used[1] > 0.5
    assert used.mean() > 0.78
