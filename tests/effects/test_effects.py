import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes

from adhesion_jax.curves import CURVES
from adhesion_jax.effects import EFFECTS, KINDS, ShapeTerm, family_of
from adhesion_jax.effects.api import AdhesionTransform, Cause, Multiplier, SlipTransform
from adhesion_jax.effects.conditions import Calendar, completed
from adhesion_jax.effects.dynamic import Dynamic
from adhesion_jax.effects.law import CorrectedLaw, with_effects

GENERIC = [name for name in KINDS if name not in EFFECTS]
TWO_COLUMNS = ("interaction", "surface")
BARE = CURVES["burckhardt"]
POINTS = 120
STILL = jnp.arange(float(POINTS))
CALENDAR = Calendar("time_s", 0.0, 3600.0)

# Compiling is what takes time here.
compiled = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


def run_of(points=POINTS, padding=0):
    """One run at 10 Hz from 1000 s on, its last point repeated `padding` times."""
    draw = np.random.default_rng(5)
    place = np.arange(points)
    speed = 15 - 0.02 * place + np.sin(place / 25)
    columns = {
        "slip": 0.05 + 0.045 * np.sin(2 * np.pi * place / 37),
        "time_s": 1000 + 0.1 * place,
        "vehicle_speed_mps": speed,
        "normal_load_N": 9e4 + 1e4 * np.sin(place / 20),
        "temperature_C": 12 + 0.05 * place,
        "relative_humidity_pct": 55 + 20 * np.cos(place / 15),
        "position_m": np.cumsum(speed) * 0.1,
        "curvature_per_m": 0.002 + 0.001 * np.sin(place / 30),
        "sanding": (place // 40 % 2).astype(float),
        "axle": (place % 7).astype(float),
        "wear": draw.normal(3.0, 1.0, POINTS)[:points],
        "gap": draw.uniform(-2.0, 5.0, POINTS)[:points],
    }
    columns = {name: np.append(z, np.repeat(z[-1], padding)) for name, z in columns.items()}
    measured = {name: jnp.asarray(z) for name, z in columns.items()}
    return measured.pop("slip"), measured


def completed_run(slip, measured):
    return slip, completed(slip, measured, CALENDAR)


SLIP, MEASURED = run_of()
RUN = completed_run(SLIP, MEASURED)
CONDITIONS = RUN[1]
FLAT = {
    **{name: np.asarray(z) for name, z in CONDITIONS.items()},
    "slip_ratio": np.asarray(SLIP),
}


def start(name):
    """An effect as the search would first try it, stronger."""
    kind = KINDS[name]
    if name in GENERIC:
        columns = {"labels": ("axle",)}.get(name, ("wear", "gap")[: 1 + (name in TWO_COLUMNS)])
        first = kind.starts({column: FLAT[column] for column in columns})[0]
    else:
        first = kind.starts(FLAT)[0]
    return dataclasses.replace(
        first, **{strength: 1.7 * getattr(first, strength) for strength in kind.FACTS.strengths}
    )


def zeroed(effect):
    return dataclasses.replace(effect, **dict.fromkeys(effect.FACTS.strengths, 0.0))


def numbers_of(effect):
    return jnp.array([float(getattr(effect, name)) for name in effect.FACTS.parameters])


def replaced(effect, numbers):
    return dataclasses.replace(effect, **dict(zip(effect.FACTS.parameters, numbers, strict=True)))


@functools.cache
def program(name):
    """Adhesion of a run under an effect and its derivatives, from the effect's numbers."""
    effect = start(name)

    def adhesion(numbers, slip, conditions):
        return with_effects(BARE, (replaced(effect, numbers),), slip, conditions)

    return compiled(lambda *arguments: (adhesion(*arguments), jax.jacfwd(adhesion)(*arguments)))


def worn(effect, name, slip=SLIP, conditions=CONDITIONS):
    return np.asarray(program(name)(numbers_of(effect), slip, conditions)[0])


@pytest.mark.parametrize("name", KINDS)
def test_without_strength_the_law_below_is_bare(name):
    bare = np.asarray(BARE(SLIP, CONDITIONS))
    for sign in (1, -1):
        np.testing.assert_allclose(
            worn(zeroed(start(name)), name, sign * SLIP), sign * bare, rtol=0, atol=1e-12
        )
    # And with strength it is not.
    assert np.abs(worn(start(name), name) - bare).max() > 1e-5


@pytest.mark.parametrize("name", KINDS)
def test_derivatives_are_those_of_central_differences(name):
    effect = start(name)
    numbers = numbers_of(effect)
    derivative = program(name)(numbers, *RUN)[1]
    for place, parameter in enumerate(effect.FACTS.parameters):
        step = 1e-6 * max(abs(float(numbers[place])), 1e-3)
        moved = jnp.zeros_like(numbers).at[place].set(step)
        ends = [program(name)(numbers + sign * moved, *RUN)[0] for sign in (1, -1)]
        expected = (ends[0] - ends[1]) / (2 * step)
        size = max(float(jnp.abs(expected).max()), 1e-9)
        np.testing.assert_allclose(
            derivative[:, place], expected, rtol=1e-5, atol=1e-6 * size, err_msg=parameter
        )


HARD = {
    "no slip": completed_run(0 * SLIP, MEASURED),
    "braking": completed_run(-SLIP, MEASURED),
    "at rest": completed_run(SLIP, {**MEASURED, "vehicle_speed_mps": 0 * SLIP}),
    "padded": completed_run(*run_of(POINTS - 30, 30)),
}


@pytest.mark.parametrize("name", KINDS)
def test_adhesion_and_derivatives_are_finite_wherever_a_run_can_be(name):
    for effect in (start(name), zeroed(start(name))):
        for case, run in HARD.items():
            adhesion, derivative = program(name)(numbers_of(effect), *run)
            assert np.isfinite(adhesion).all(), case
            assert np.isfinite(derivative).all(), case


@pytest.mark.parametrize("name", KINDS)
def test_a_padded_tail_changes_nothing_before_it(name):
    found = worn(start(name), name, *HARD["padded"])
    # Slopes look at most twelve points ahead.
    kept = slice(0, POINTS - 30 - 12)
    np.testing.assert_allclose(found[kept], worn(start(name), name)[kept], rtol=1e-12)


#: One point of a journey; neither speed nor anything else changes.
STEADY = {name: float(z[7]) for name, z in MEASURED.items() if name != "time_s"} | {
    "acceleration_mps2": 0.0,
    "wheel_angle_rad": 1.0,
    "campaign_time": 0.3,
}


@pytest.mark.parametrize("name", lanes(KINDS, always=5, thorough=10, long=5))
def test_a_steady_state_has_a_peak_and_is_that_of_a_run_in_which_nothing_changes(name):
    effect = start(name)
    law = CorrectedLaw(BARE, (effect,), {"wear": (2.0, 4.0)}, CALENDAR)
    slips = jnp.linspace(0.0, 0.5, 20_001)

    @compiled
    def program_of_a_point():
        scan = jax.vmap(lambda slip: law(slip, STEADY))(slips)
        return law.peak(STEADY, 0.5), scan

    peak, scan = program_of_a_point()
    best = int(scan.argmax())
    assert bool(peak.found) == (0 < best < 20_000)
    assert float(peak.slip) == pytest.approx(float(slips[best]), abs=2.6e-5)
    assert float(peak.adhesion) == pytest.approx(float(scan[best]), abs=1e-8)
    # The work of cleaning grows without end: before any is done there is the steady state.
    step = 0.0 if name == "cleaning" else 0.1
    run = {key: jnp.full(POINTS, z) for key, z in STEADY.items()}
    run = completed(jnp.full(POINTS, slips[1600]), {**run, "time_s": STILL * step}, CALENDAR)
    run = {**run, "campaign_time": jnp.full(POINTS, 0.3)}
    end = worn(effect, name, jnp.full(POINTS, slips[1600]), run)[-1]
    assert end == pytest.approx(float(scan[1600]), rel=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_everything_is_described(name):
    kind = KINDS[name]
    fields = [field.name for field in dataclasses.fields(kind)]
    named = {"column", "first", "second", "acts_on"}
    assert [field for field in fields if field not in named] == [*kind.FACTS.parameters]
    for parameter in kind.FACTS.parameters.values():
        assert parameter.unit
        assert parameter.meaning
        assert len(parameter.source) > 5
        assert parameter.lower < parameter.upper
    assert kind.FACTS.strengths
    assert {*kind.FACTS.strengths} <= {*kind.FACTS.parameters} - {*kind.FACTS.references}
    assert {*kind.FACTS.references} <= {*kind.FACTS.parameters}
    assert {*kind.FACTS.needs} <= {*FLAT}
    assert kind.ORDER in (0, 1, 2, 3)
    # A term of the curve is told by its function, the others by what they make of the adhesion.
    assert ("g = " if issubclass(kind, ShapeTerm) else "mu") in kind.FACTS.formula
    assert ("{}" in kind.FACTS.phrase) == (name not in EFFECTS)
    for strength in kind.FACTS.strengths:
        assert kind.FACTS.parameters[strength].lower <= 0 < kind.FACTS.parameters[strength].upper


@pytest.mark.parametrize("name", KINDS)
def test_starts_lie_inside_the_bounds_and_are_not_nothing(name):
    starts = KINDS[name].starts({key: z for key, z in FLAT.items() if np.ptp(z) > 0})
    assert starts
    for effect in starts:
        for key, parameter in effect.FACTS.parameters.items():
            assert parameter.lower <= float(getattr(effect, key)) <= parameter.upper
        assert any(float(getattr(effect, key)) != 0 for key in effect.FACTS.strengths)
    assert len({repr(effect) for effect in starts}) == len(starts)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_cause_says_what_others_must_know_of_it(name):
    cause = EFFECTS[name]
    assert cause.FACTS.sentence.endswith(".")
    assert cause.FACTS.family
    assert cause.FACTS.rests_on
    # Another name for it is a form over columns, or a cause of its own family.
    for same in cause.FACTS.same_as:
        kind, colon, column = same.partition(":")
        assert (colon and kind in KINDS and column) or EFFECTS[
            same
        ].FACTS.family == cause.FACTS.family
        assert family_of(same) == cause.FACTS.family
    assert issubclass(cause, Dynamic) == ("time_s" in cause.FACTS.needs)
    if issubclass(cause, Dynamic):
        assert cause.FACTS.driven_by in ("slip_ratio", *cause.FACTS.needs)


def fine_run(step):
    """Twelve seconds of smooth driving, sampled every `step` seconds; sand from 3 to 6 s."""
    time = jnp.arange(0.0, 12.0, step)
    speed = 12 + 2 * jnp.sin(time / 5)
    conditions = {
        "time_s": time,
        "vehicle_speed_mps": speed,
        "acceleration_mps2": 0.4 * jnp.cos(time / 5),
        "normal_load_N": jnp.full_like(time, 9e4),
        "sanding": ((time >= 3) & (time < 6)).astype(float),
    }
    return 0.04 + 0.03 * jnp.sin(0.9 * time), conditions


def error_of_steps(effect, step, since):
    """The largest difference between a run step by step and the whole, from that time on."""
    law = CorrectedLaw(BARE, (effect,), {}, CALENDAR)
    slip, conditions = fine_run(step)
    first = jax.tree.map(lambda column: column[0], (slip, conditions))
    _, found = jax.lax.scan(
        lambda memory, now: law.step(memory, *now), law.init(*first), (slip, conditions)
    )
    whole = law(slip, conditions)
    assert float(jnp.max(jnp.abs(whole - BARE(slip, conditions)))) > 1e-3
    return float(jnp.max(jnp.abs(found - whole)[conditions["time_s"] >= since]))


@pytest.mark.thorough
@pytest.mark.parametrize(
    "name", [name for name, cause in EFFECTS.items() if issubclass(cause, Dynamic)]
)
def test_step_by_step_a_memory_gives_what_the_whole_run_gives(name):
    """Exactly, or with an error that falls in proportion to the step where `after` looks ahead."""
    start = EFFECTS[name].starts({})[-1]
    strong = {key: 10 * getattr(start, key) for key in start.FACTS.strengths}
    # Ten times the constant of these would be as long as the run.
    slow = name in ("lag", "relaxation", "delay")
    effect = dataclasses.replace(start, **({} if slow else strong))
    # A rate is not known at the first sample: what follows from it has died away by then.
    if name not in ("hysteresis", "inertia"):
        assert error_of_steps(effect, 0.1, since=0.5) < 1e-12
        return
    coarse, fine = (error_of_steps(effect, step, since=0.5) for step in (0.01, 0.00125))
    assert coarse / fine == pytest.approx(8, rel=0.2)


@pytest.mark.long
def test_a_hysteresis_of_long_memory_begins_in_a_loop_as_in_a_whole_run():
    effect = EFFECTS["hysteresis"](k=0.3, rate=0.05, memory=2.0)
    coarse, fine = (error_of_steps(effect, step, since=0.0) for step in (0.01, 0.00125))
    assert coarse / fine == pytest.approx(8, rel=0.2)


def test_effects_with_memory_are_advanced_one_after_the_other_in_a_compiled_loop_of_many_runs():
    """Sand before a lag, in 3 runs of a plant whose slip follows from the adhesion itself."""
    sand = EFFECTS["sanding"](k=0.5, build_up=0.3, decay=3.0)
    law = CorrectedLaw(BARE, (EFFECTS["lag"](time_constant=0.4), sand), {}, CALENDAR)
    step = 0.05

    def driven(torque):
        """Each sample: the wheel speeds up by what torque is left over from adhesion."""

        def advance(carry, time):
            memory, slip = carry
            conditions = {"time_s": time, "sanding": (time > 1.0).astype(float)}
            memory, adhesion = law.step(memory, slip, conditions)
            return (memory, slip + step * 0.2 * (torque - adhesion)), (slip, adhesion)

        first = jnp.asarray(0.01)
        begun = law.init(first, {"time_s": jnp.zeros(()), "sanding": jnp.zeros(())})
        times = step * jnp.arange(80.0)
        return jax.lax.scan(advance, (begun, first), times)[1]

    slips, adhesions = jax.jit(jax.vmap(driven))(jnp.array([0.1, 0.2, 0.25]))
    times = step * jnp.arange(80.0)
    conditions = {"time_s": times, "sanding": (times > 1.0).astype(float)}
    for slip, adhesion in zip(slips, adhesions, strict=True):
        np.testing.assert_allclose(adhesion, law(slip, conditions), rtol=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_only_effects_of_order_zero_bend_the_slip(name):
    # The compiled program leaves out what the others do before the curve.
    effect = start(name)
    for slip in (SLIP, -SLIP):
        bent = np.asarray(effect.before(slip, CONDITIONS))
        if KINDS[name].ORDER > 0:
            np.testing.assert_array_equal(bent, slip)
        else:
            assert np.abs(bent - slip).max() > 1e-5


@pytest.mark.parametrize("name", EFFECTS)
def test_a_cause_that_scales_bends_or_changes_does_nothing_else(name):
    cause = EFFECTS[name]
    (kind,) = [
        kind
        for kind in (Multiplier, SlipTransform, AdhesionTransform, Cause)
        if issubclass(cause, kind)
    ][:1]
    if kind is Cause:  # of both
        assert name == "lateral_creep"
        return
    kept = {
        Multiplier: ("before", "after"),
        SlipTransform: ("after",),
        AdhesionTransform: ("before",),
    }[kind]
    assert [getattr(cause, method) is getattr(kind, method) for method in kept] == [True] * len(
        kept
    )
    assert (cause.ORDER == 0) == (kind is SlipTransform)


def test_acceleration_is_the_slope_of_the_speed_about_half_a_second():
    """A straight line by least squares, with Gaussian weights of .5 s, at a point inside."""
    time = 0.1 * np.arange(40)
    speed = 10 + np.sin(2 * time)
    calendar = Calendar("time_s", 0.0, 4.0)
    measured = {"time_s": jnp.asarray(time), "vehicle_speed_mps": jnp.asarray(speed)}
    found = completed(jnp.full(40, 0.01), measured, calendar)
    near = slice(20 - 12, 20 + 13)
    lead = time[near] - time[20]
    slope = np.polyfit(lead, speed[near], 1, w=np.exp(-(lead**2) / (4 * 0.5**2)))[0]
    assert float(found["acceleration_mps2"][20]) == pytest.approx(slope, rel=1e-9)


def test_a_wheel_of_920_mm_turns_once_in_its_circumference():
    speed = np.full(41, 0.92 * np.pi / 4)
    measured = {"time_s": 0.1 * jnp.arange(41), "vehicle_speed_mps": jnp.asarray(speed)}
    found = completed(jnp.zeros(41), measured, Calendar("time_s", 0.0, 4.0))["wheel_angle_rad"]
    assert float(found[-1] - found[0]) == pytest.approx(2 * np.pi, rel=1e-9)
