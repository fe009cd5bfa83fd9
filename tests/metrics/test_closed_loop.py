"""The figures of a run, reduced sample by sample, against the same from all samples at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.metrics.closed_loop import (
    FIGURES,
    RUNAWAY,
    Sample,
    add,
    by_segment,
    figures,
    start,
    whole,
)

PERIOD = 0.01


def samples_of(rows, segments, seed=0, **given):
    """Random samples [rows] on some segments one after the other, with what is given instead."""
    random = np.random.default_rng(seed)
    axles = 2
    columns = {
        "segment": np.repeat(np.arange(segments), rows // segments),
        "counts": np.ones(rows, dtype=bool),
        "direction": np.ones(rows),
        "slip": random.uniform(0.0, 0.4, (rows, axles)),
        "optimum": np.full((rows, axles), 0.2),
        "adhesion": random.uniform(0.0, 0.3, (rows, axles)),
        "largest": np.full((rows, axles), 0.3),
        "observed": random.uniform(0.0, 0.3, (rows, axles)),
        "asked": random.uniform(0.0, 0.4, (rows, axles)),
        "torque": random.uniform(0.0, 9e3, (rows, axles)),
        "shaft": random.uniform(-4e4, 3e4, (rows, axles)),
        "static_shaft": random.uniform(1e4, 2e4, (rows, axles)),
        "slip_power": random.uniform(0.0, 1e4, rows),
        "pull": random.uniform(0.0, 1e5, rows),
        "largest_pull": random.uniform(1e5, 2e5, rows),
        "train_speed": 5 + np.cumsum(random.normal(size=rows)) * 0.01,
    }
    return Sample(**{name: jnp.asarray(x) for name, x in (columns | given).items()})


def totals_of(samples, segments):
    def one(totals, row):
        number, sample = row
        return add(totals, sample, number, PERIOD), None

    first = jax.tree.map(lambda x: x[0], samples)
    rows = jnp.arange(len(samples.segment))
    return jax.lax.scan(one, start(first, segments, PERIOD), (rows, samples))[0]


def brute(samples, segment):
    """The figures of one segment, from all of its samples."""
    x = Sample(*map(np.asarray, samples))
    here = np.nonzero((x.segment == segment) & x.counts)[0]
    settled = here[(np.arange(len(here)) * PERIOD) >= 2.0]
    acceleration = np.concatenate([[0.0], np.diff(x.train_speed)]) / PERIOD
    jerk = np.concatenate([[0.0, 0.0], np.diff(acceleration[1:])]) / PERIOD
    moved = np.concatenate([[0.0], np.abs(np.diff(x.torque, axis=0)).mean(axis=1)])
    share = (x.direction[:, None] * x.adhesion / x.largest).mean(axis=1)

    def rms(values):
        return np.sqrt(np.mean(values**2))

    stretch = 30
    reached = np.nan
    for begin in range(len(here) - stretch + 1):
        if np.mean(share[here[begin : begin + stretch]] >= 0.95) >= 0.95:
            reached = begin * PERIOD
            break
    slip_energy = PERIOD * x.slip_power[here].sum()
    gained = PERIOD * (x.direction * x.pull * x.train_speed)[here].sum()
    work = abs(gained)
    return {
        "utilisation": share[here].mean(),
        "pull": (x.direction * x.pull)[here].mean() / 1e3,
        "pull_share": (x.direction * x.pull)[here].sum() / x.largest_pull[here].sum(),
        "overshoot": (x.direction[:, None] * (x.slip - x.optimum))[here].max(),
        "t95": reached,
        "never95": float(np.isnan(reached)),
        "slip_energy": slip_energy,
        "slip_energy_share": slip_energy / work if work > 0 else np.nan,
        "utility_0": gained,
        "utility_1": gained - slip_energy,
        "utility_3": gained - 3 * slip_energy,
        "torque_variation": moved[here].sum() / 1e3 / (PERIOD * len(here)),
        "torque_largest": np.abs(x.torque[here]).max() / 1e3,
        "axle_torque_over_static": np.abs(x.shaft[here]).max() / x.static_shaft[here].max(),
        "jerk_rms": rms(jerk[here]),
        "tracking_rms": rms((x.slip - x.optimum)[here]),
        "tracking_rms_settled": rms((x.slip - x.optimum)[settled]),
        "estimation_rms": rms((x.asked - x.slip)[here]),
        "estimation_rms_settled": rms((x.asked - x.slip)[settled]),
        "adhesion_rms": rms((x.observed - x.adhesion)[here]),
        "slip_settled": (x.direction[:, None] * x.slip)[settled].mean(),
        "utilisation_settled": share[settled].mean(),
        "ran_away": float((np.abs(x.slip) > RUNAWAY * np.abs(x.optimum))[settled].any()),
        "rolled_back": float(x.train_speed[here].min() < -0.01),
        "stood": float(np.abs(x.train_speed[here]).max() < 0.01),
    }


def near_the_peak(rows, begins, falls=()):
    """Adhesion below .95 of the largest before a row and at some rows, above it elsewhere."""
    share = np.where(np.arange(rows) < begins, 0.5, 0.97)
    share[list(falls)] = 0.9
    return 0.3 * np.broadcast_to(share[:, None], (rows, 2))


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"adhesion": near_the_peak(900, 77, (80, 110))},  # two of any thirty are too many
        {"adhesion": near_the_peak(900, 77, (90,))},
        {"adhesion": near_the_peak(900, 299)},  # which the switch at row 300 cuts off
        {"slip": np.where(np.arange(900)[:, None] == 250, 3.0, np.full((900, 2), 0.2))},
        {"slip": np.where(np.arange(900)[:, None] == 50, 3.0, np.full((900, 2), 0.2))},
        {"train_speed": np.linspace(1.0, -1.0, 900)},
        {"train_speed": np.zeros(900)},
        {"direction": -np.ones(900), "optimum": np.full((900, 2), -0.2)},
    ],
)
def test_figures_are_those_of_all_samples_at_once(given):
    samples = samples_of(900, 3, **given)
    found = figures(by_segment(totals_of(samples, 3)), PERIOD)
    assert set(found) == set(FIGURES)
    for segment in range(3):
        expected = brute(samples, segment)
        for name, figure in found.items():
            np.testing.assert_allclose(
                figure[segment], expected[name], rtol=1e-9, atol=1e-12, err_msg=name
            )


def test_t95_begins_with_its_stretch():
    samples = samples_of(900, 3, adhesion=near_the_peak(900, 77, (90,)))
    found = figures(by_segment(totals_of(samples, 3)), PERIOD)
    # The fall at row 90 is the one sample of thirty that may be below.
    assert float(found["t95"][0]) == pytest.approx(0.77)
    assert found["t95"][1:].tolist() == [0.0, 0.0]


def test_the_whole_run_is_one_segment():
    samples = samples_of(900, 3)
    found = figures(whole(totals_of(samples, 3)), PERIOD)
    one = samples._replace(segment=jnp.zeros(900, dtype=int))
    expected = brute(one, 0)
    for name in ("utilisation", "overshoot", "slip_energy_share", "tracking_rms", "jerk_rms"):
        np.testing.assert_allclose(found[name], [expected[name]], rtol=1e-9, err_msg=name)


def test_braking_is_useful_work_as_traction_is():
    """Of 1 kN at 5 m/s for 3 s each way: 30 kJ, and of 300 W of slip 1.8 kJ, .06 of them."""
    way = np.repeat([1.0, -1.0], 300)
    samples = samples_of(
        600,
        2,
        direction=way,
        pull=1e3 * way,
        slip=np.stack([0.2 * way, 0.2 * way], axis=1),
        train_speed=np.full(600, 5.0),
        slip_power=np.full(600, 300.0),
    )
    totals = totals_of(samples, 2)
    found, parts = figures(whole(totals), PERIOD), figures(by_segment(totals), PERIOD)
    np.testing.assert_allclose(found["utility_0"], [30e3])
    np.testing.assert_allclose(parts["utility_0"], [15e3, 15e3])
    np.testing.assert_allclose(found["slip_energy_share"], [0.06])
    np.testing.assert_allclose(found["slip_settled"], [0.2])


def test_a_segment_that_is_not_reached_has_no_figures():
    samples = samples_of(300, 1)
    found = figures(by_segment(totals_of(samples, 2)), PERIOD)
    assert all(np.isnan(figure[1]) for figure in found.values())
    assert np.isfinite(found["utilisation"][0])


def test_after_the_driver_is_done_nothing_counts():
    samples = samples_of(600, 1, counts=np.arange(600) < 300)
    found = figures(by_segment(totals_of(samples, 1)), PERIOD)
    np.testing.assert_allclose(found["utilisation"][0], brute(samples, 0)["utilisation"])
    no_seeker = samples_of(600, 1, asked=np.full((600, 2), np.nan))
    found = figures(by_segment(totals_of(no_seeker, 1)), PERIOD)
    assert np.isnan(found["estimation_rms"][0])
    assert np.isfinite(found["tracking_rms"][0])


def figures_of_a_constant(rows, **given):
    """The figures of one segment whose samples are all alike but for what is given."""
    still = {"slip": np.full((rows, 2), 0.2), "train_speed": np.full(rows, 5.0)}
    totals = totals_of(samples_of(rows, 1, **(still | given)), 1)
    return {name: float(one[0]) for name, one in figures(whole(totals), PERIOD).items()}


def test_a_stretch_of_three_tenths_of_a_second_is_long_enough():
    # Samples of .01 s, near the peak at the end: of thirty one may be away from it.
    for last, reached in ((29, True), (28, False)):
        adhesion = near_the_peak(600, 600 - last)
        assert figures_of_a_constant(600, adhesion=adhesion)["never95"] == (not reached)


@pytest.mark.parametrize(("factor", "away"), [(4.9, 0.0), (5.1, 1.0)])
def test_slip_has_run_away_beyond_five_times_that_of_the_optimum(factor, away):
    assert figures_of_a_constant(300, slip=np.full((300, 2), factor * 0.2))["ran_away"] == away


@pytest.mark.parametrize(("speed", "stood", "back"), [(0.0098, 1.0, 0.0), (-0.0102, 0.0, 1.0)])
def test_a_train_stands_below_a_hundredth_of_a_metre_per_second(speed, stood, back):
    found = figures_of_a_constant(300, train_speed=np.full(300, speed))
    assert (found["stood"], found["rolled_back"]) == (stood, back)
