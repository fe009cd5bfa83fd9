"""Delay, overshoot and resets of sequences made by hand, against plain counting."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.campaign.job import MAIN_JOB, Config, parts_of
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.metrics.tracking import (
    BY_BLOCK,
    BY_SAMPLE,
    Tracker,
    delay_counts,
    lags,
    tracking_row,
    tracking_statistics,
)

DRY, COMMON = 0.8, 0.3


def followed(tracker, values, resets):
    """What is seen of one run: mu_max of each step and whether it is a reset, [blocks, steps]."""

    def step(seen, now):
        block, mu_max, reset = now
        return tracker.update(seen, block, {"mu_max": mu_max}, reset), None

    blocks = jnp.repeat(jnp.arange(len(values)), values.shape[1])
    steps = (blocks, jnp.asarray(values.ravel()), jnp.asarray(resets.ravel()))
    return jax.jit(lambda: jax.lax.scan(step, tracker.init(), steps)[0])()


def stream(after, resets_after=(), has_resets=True):
    """A stream of 100 samples on dry rail, tracked from the first, then these on common rail.

    `resets_after` are the samples on the common rail at which there is a reset.
    """
    rails, truth = ["dry"] * 10 + ["common"] * 10, np.repeat([DRY, COMMON], 10)
    tracker = Tracker.of(rails, truth, BY_SAMPLE, has_resets)
    values = np.concatenate([np.full(100, DRY), after]).reshape(20, 10)
    resets = np.zeros(200, dtype=bool)
    resets[100 + np.array(resets_after, dtype=int)] = True
    return followed(tracker, values, resets.reshape(20, 10))


def rows_of(seen, stretch, unit="sample"):
    runs = jax.tree.map(lambda x: np.stack([x, x]), seen)
    counts = delay_counts(runs, int(runs.length.max()))
    none = np.full(runs.delay.shape, np.nan)
    moments = Moments.of(tracking_statistics(runs, none)).at((stretch,))
    return tracking_row(counts[stretch], moments, stretch == 0, unit)


@pytest.mark.parametrize("delay", [0, 1, 7, 37, 90])
def test_the_delay_is_the_first_of_ten_samples_in_a_row_within_three_per_cent(delay):
    after = np.full(100, DRY)
    after[delay:] = COMMON * 1.029
    row = rows_of(stream(after), 1)
    assert row["delay_median"] == row["delay_mean"] == delay
    assert row["never_tracked_share"] == 0
    assert row["unit"] == "sample"


def test_nine_in_a_row_are_not_enough_and_three_per_cent_is_the_limit():
    after = np.full(100, COMMON * 1.031)
    after[20:29] = COMMON
    row = rows_of(stream(after), 1)
    assert row["never_tracked_share"] == 1
    assert row["delay_mean"] == 100  # all the samples there were
    after[40:50] = COMMON
    assert rows_of(stream(after), 1)["delay_mean"] == 40
    # Samples within the limit of the rail before do not count for the one after.
    late = np.full(100, DRY)
    late[91:] = COMMON
    assert rows_of(stream(late), 1)["never_tracked_share"] == 1


def test_overshoot_is_the_furthest_beyond_the_truth_seen_from_the_rail_before():
    after = np.full(100, COMMON)
    after[:5] = DRY  # on the way is not beyond
    after[10], after[12] = 0.9 * COMMON, 0.8 * COMMON
    seen = stream(after)
    assert rows_of(seen, 1)["overshoot"] == pytest.approx(0.2)
    assert np.isnan(rows_of(seen, 0)["overshoot"])


def test_a_reset_within_twenty_samples_answers_a_switch_and_a_later_one_is_false():
    row = rows_of(stream(np.full(100, COMMON), [19, 20, 60]), 1)
    assert row["missed_share"] == 0
    assert row["false_resets_per_1000"] == pytest.approx(1000 * 2 / 100)
    assert rows_of(stream(np.full(100, COMMON), [20, 60]), 1)["missed_share"] == 1


def test_a_method_that_never_answers_has_missed_the_switch():
    row = rows_of(stream(np.full(100, DRY)), 1)
    assert row["missed_share"] == 1
    assert row["false_resets_per_1000"] == 0


def test_a_method_without_resets_has_missed_none_and_made_no_false_ones():
    row = rows_of(stream(np.full(100, COMMON), has_resets=False), 1)
    assert np.isnan(row["missed_share"])
    assert np.isnan(row["false_resets_per_1000"])


def test_blocks_are_counted_one_by_one():
    rails = ["dry"] * 3 + ["common"] * 4
    tracker = Tracker.of(rails, np.repeat([DRY, COMMON], [3, 4]), BY_BLOCK, True)
    values = np.array([DRY, DRY, DRY, DRY, DRY, COMMON, COMMON])[:, None]
    resets = np.array([0, 0, 0, 1, 1, 0, 0], dtype=bool)[:, None]
    seen = followed(tracker, values, resets)
    row = rows_of(seen, 1, "block")
    assert row["delay_mean"] == 2
    assert row["missed_share"] == 0
    assert row["false_resets_per_1000"] == pytest.approx(1000 / 4)
    assert rows_of(seen, 0, "block")["false_resets_per_1000"] == 0


def test_identifiers_that_nothing_in_the_main_job_takes_are_named():
    with pytest.raises(InputError, match=r"--identifiers rls-slope does not go"):
        parts_of(Config(identifiers=("ml-exact", "rls-slope")), MAIN_JOB)
    with pytest.raises(InputError, match=r"--identifiers magic is unknown"):
        parts_of(Config(identifiers=("ml-exact", "magic")), MAIN_JOB)
    parts = parts_of(Config(identifiers=("riv", "ml-exact")), MAIN_JOB)
    assert [(part.scenario, part.identifiers) for part in parts] == [
        ("he2018-blocks", ("ml-exact",)),
        ("qian2024-switch", ("riv",)),
    ]
    own = {**IDENTIFIERS, "mine": IDENTIFIERS["riv"]}
    (part,) = parts_of(Config(identifiers=("mine",)), MAIN_JOB, own)
    assert (part.scenario, part.identifiers) == ("qian2024-switch", ("mine",))


def test_the_lag_is_the_delay_of_a_truth_that_is_told_late():
    """On a line, on a wave that is told 30 samples late, and in none that stays."""
    after, stretch = 10 * np.arange(1, 101), np.repeat([0, 1], 50)
    line = np.concatenate([0.8 - 1e-4 * after[:50], np.full(50, 0.3)])
    late = np.concatenate([0.8 - 1e-4 * (after[:50] - 70), np.full(50, 0.31)])
    found = lags(np.stack([line, late]), line, stretch, 10)
    np.testing.assert_allclose(found[:, 0], [0, 70], atol=1e-9)
    assert np.isnan(found[:, 1]).all()

    def wave(samples):
        return 0.7 + 0.05 * np.sin(2 * np.pi * samples / 500)

    found = lags(wave(after - 30)[None], wave(after), np.zeros(100, dtype=int), 10)
    assert found[0, 0] == pytest.approx(30, rel=0.03)  # the sine of its phase, 0.37
