"""A limit of the force is not taken for the peak of the rail: simulated logs, and direct sums."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from lanes import lanes

import adhesion_jax as aj
from adhesion_jax.data import to_measured
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.measured.fall import empty, extended, fall_of
from adhesion_jax.measured.following import as_told, follow_log
from adhesion_jax.measured.log import to_log

FAULTS = Path(__file__).parents[3] / "shared" / "faults" / "field"
NAMES = ("riv", "rls-kiencke", "qp-qian2024-1")

#: Kiencke's curve with its peak of .3 at slip .05, that of .12 there at slip .0042, and a rail of
#: half the adhesion at every slip.
A0, P1, P2, SLIP_OPT = 40.0, 280 / 3, 400.0, 0.05
LIMIT, SPEED, WHEEL_NOISE, SIGMA = 0.12, 12.0, 0.01, 0.003

#: With more noise of the slip the riv gives up the past in every sweep.
LITTLE_NOISE = 0.001


def curve(slip, level=1.0):
    return level * A0 * slip / (1 + P1 * slip + P2 * slip**2)


def limited(count, level=1.0):
    """Adhesion asked for in waves of 9 s, which the force limits, and the slip that it takes."""
    asked = np.clip(1.5 * LIMIT * np.abs(np.sin(2 * np.pi * 0.02 * np.arange(count) / 9)), 0, LIMIT)
    rising = np.linspace(0, SLIP_OPT, 20_001)
    return np.interp(asked, curve(rising, level), rising), asked


def swept(count):
    slip = 0.1 * (1 - np.cos(2 * np.pi * 0.02 * np.arange(count) / 3.7)) + 0.001
    return slip, curve(slip)


def measured(seed, *parts, noise=WHEEL_NOISE):
    """A log at 50 Hz of parts one after the other, with noise of the wheel and of adhesion."""
    random = np.random.default_rng(seed)
    slip, adhesion = map(np.concatenate, zip(*parts, strict=True))
    return pd.DataFrame(
        {
            "time_s": 0.02 * np.arange(slip.size),
            "vehicle_speed_mps": SPEED,
            "slip_ratio": slip + noise / SPEED * random.normal(size=slip.size),
            "adhesion": adhesion + SIGMA * random.normal(size=slip.size),
        }
    )


def estimates(table):
    log = to_log(to_measured("log", table), False)
    methods = {name: IDENTIFIERS[name] for name in NAMES}
    return {name: one.estimates for name, one in follow_log(methods, log, np.array([A0])).items()}


@pytest.mark.long
def test_a_limit_of_the_force_is_no_peak():
    for seed in range(3):
        for name, table in estimates(measured(seed, limited(3000))).items():
            assert table["at_least"].all(), name
            told = as_told(table)
            # One sample in 40 may seem to have reached more by chance, by hardly more than that.
            assert told["mu_max"].max() < 1.01 * LIMIT
            assert told[["mu_max_se", "slip_opt", "slip_opt_se"]].isna().all(axis=None)
            if not table["resets"].iloc[-1]:
                assert told["mu_max"].iloc[-1] == pytest.approx(LIMIT, rel=0.03)


def test_braking_is_limited_as_traction_is():
    table = measured(1, limited(2000))
    turned = table.assign(slip_ratio=-table["slip_ratio"], adhesion=-table["adhesion"])
    for there, back in zip(estimates(table).values(), estimates(turned).values(), strict=True):
        pd.testing.assert_series_equal(there["at_least"], back["at_least"])
        np.testing.assert_allclose(there["reached"], back["reached"], rtol=1e-9)


def test_sweeps_beyond_the_peak_show_it():
    """The slip is beyond 1.4 times that of the peak from sample 37 on, and largest at 92."""
    for seed in range(3):
        for name, table in estimates(measured(seed, swept(1000), noise=LITTLE_NOISE)).items():
            assert table["at_least"][:37].all(), name
            assert not table["at_least"][150:].any(), name
            last = as_told(table).iloc[-1]
            assert last["mu_max"] == pytest.approx(0.3, rel=0.02)
            assert last["slip_opt"] == pytest.approx(SLIP_OPT, rel=0.1)


def test_the_flag_falls_with_the_first_sweep_and_rises_with_a_rail_whose_force_is_limited():
    """Force limited to sample 1000, sweeps to 1740, then limited on a rail of half the adhesion."""
    parts = limited(1000), swept(740), limited(1500, level=0.5)
    for seed in range(3):
        found = estimates(measured(seed, *parts, noise=LITTLE_NOISE))
        for name, table in found.items():
            flag = table["at_least"].to_numpy()
            assert flag[: 1000 + 37].all(), name
            assert not flag[1000 + 185 : 1740].any(), name
        # The riv gives up the past once the other rail contradicts it, and with it the fall.
        riv = found["riv"]
        reset = riv["sample"][riv["reset"] & (riv["sample"] >= 1740)].min()
        assert reset < 1740 + 150
        # The other one forgets the sweeps evenly.
        for name, begin in (("riv", reset), ("rls-kiencke", 1740 + 500)):
            assert found[name]["at_least"][begin:].all(), name
            assert found[name]["reached"].iloc[-1] == pytest.approx(LIMIT, rel=0.03)


def test_a_fall_is_seen_no_longer_than_the_method_remembers_it():
    """Three sweeps, the last beyond the peak until sample 500, then 36 s of slips below .03."""
    rolling = 0.03 * np.sin(2 * np.pi * 0.02 * np.arange(1800) / 14) ** 2
    parts = swept(555), (rolling, curve(rolling))
    for seed in range(3):
        found = estimates(measured(seed, *parts, noise=LITTLE_NOISE))
        for name, table in found.items():
            assert not table["at_least"][150 : 555 + 50].any(), name
        # A hundred samples are the memory of rls-kiencke; the riv gives up nothing here.
        assert found["rls-kiencke"]["at_least"][555 + 300 :].all()
        assert not found["riv"]["at_least"][150:].any()
        assert found["riv"]["resets"].iloc[-1] == 0


@pytest.mark.parametrize("share", lanes([0.3, 0.6, 0.9, 1.0, 1.2], always=2, thorough=3))
def test_noise_of_the_slip_fakes_no_fall(share):
    """A hold at slip .004 with noise of a quarter of it, after a ramp, wherever the peak is put."""
    falls = []
    for seed in range(20):
        random = np.random.default_rng(seed)
        true = 0.004 * np.minimum(np.arange(1500) / 100, 1)
        slip = true + 0.001 * random.normal(size=1500)
        found = window_of(slip, curve(true) + SIGMA * random.normal(size=1500), share * 0.004)
        fall = fall_of(found, jnp.asarray(share * 0.004), jnp.asarray(1.0))
        falls.append(float(fall.fall / fall.fall_se))
    assert np.nanmax([*falls, -1.0]) < 3


@jax.jit
def window_of(slip, adhesion, slip_opt, forgetting=1.0, reset=-1):
    def step(window, sample):
        slip, adhesion, number = sample
        arguments = jnp.asarray(slip_opt), jnp.asarray(forgetting), number == reset, number == 0
        return extended(window, slip, adhesion, *arguments, jnp.asarray(1.0)), None

    samples = jnp.asarray(slip), jnp.asarray(adhesion), jnp.arange(len(slip))
    return jax.lax.scan(step, empty(), samples)[0]


def test_the_running_sums_are_those_of_all_samples_with_their_weights():
    random = np.random.default_rng(3)
    slip = random.uniform(0.002, 0.2, 400) * (np.arange(400) % 7 > 0)
    adhesion = random.normal(0.2, 0.05, 400) * np.sign(slip)
    window = window_of(slip, adhesion, 0.05, forgetting=0.998, reset=100)
    evenly, by_slip = (
        np.array([np.prod(kept[k + 1 :]) for k in range(400)]) * (np.arange(400) >= 100)
        for kept in (np.full(400, 0.998), 1 - 0.002 * np.minimum(slip / 0.05, 1))
    )
    cell = np.maximum(48 + np.floor(4 * np.log2(slip + 1e-9)).astype(int), 0)
    for row, values in enumerate((1.0, adhesion, adhesion**2)):
        direct = np.bincount(cell, evenly * values, minlength=48)
        np.testing.assert_allclose(window.sums[row], direct, rtol=1e-9, atol=1e-12)
        assert float(jnp.sum(window.levels[row])) == pytest.approx(np.sum(by_slip * values))


def test_a_fall_and_its_error_are_those_of_two_means():
    """Slips of one cell around the peak and of one beyond it, both in the middle of their cells."""
    random = np.random.default_rng(4)
    high, low = 2 ** ((np.array([-17, -11]) + 0.5) / 4)
    adhesion = np.concatenate([random.normal(0.3, 0.01, 60), random.normal(0.25, 0.01, 30)])
    window = window_of(np.repeat([high, low], [60, 30]), adhesion, 0.999)
    fall = fall_of(window, jnp.asarray(high), jnp.asarray(1.0))
    parts = adhesion[:60], adhesion[60:]
    assert float(fall.fall) == pytest.approx(parts[0].mean() - parts[1].mean(), rel=1e-3)
    pooled = sum(np.sum((part - part.mean()) ** 2) for part in parts) / 88
    error = np.sqrt(sum(max(pooled, part.var(ddof=1)) / part.size for part in parts))
    assert float(fall.fall_se) == pytest.approx(error, rel=1e-2)


def test_a_sample_that_is_not_finite_changes_nothing():
    slip, adhesion = np.array([0.01, np.nan, 0.02, 0.03]), np.array([0.1, 0.1, np.inf, 0.2])
    clean = window_of(slip[[0, 3]], adhesion[[0, 3]], 0.05)
    for one, other in zip(window_of(slip, adhesion, 0.05), clean, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.thorough
@pytest.mark.skipif(not FAULTS.exists(), reason="the collection of logs is not here")
def test_coasting_with_holds_reaches_and_with_sweeps_has_a_peak():
    """An adhesion of .2205 is held; what forgets or resets remembers a last roll out as well."""
    before = "riv", "qp-qian2024-1", "rls-kiencke"
    holds = aj.track(FAULTS / "coasting_holds.csv", identifiers=before)
    sweeps = aj.track(FAULTS / "coasting_sweeps.csv", identifiers=before)
    assert holds.estimates["at_least"].all()
    assert holds.summary["mu_max"][1:].between(0.21, 0.2205).all()
    assert "at least 0.21" in f"{holds}"
    assert "adhesion does not fall in the window" in " ".join(holds.verdict.split())
    assert not sweeps.summary["at_least"].any()
    np.testing.assert_allclose(sweeps.summary["mu_max"], 0.3, rtol=0.1)
    assert aj.track(FAULTS / "coasting_holds.csv").estimates["mu_max"].max() < 0.2215
    assert aj.track(FAULTS / "coasting_sweeps.csv").summary["mu_max"].between(0.25, 0.33).all()
