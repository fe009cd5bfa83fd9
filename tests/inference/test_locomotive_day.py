"""The log of a locomotive obeys Newton and holds the adhesion, delay and noise that it tells."""

import numpy as np
import pandas as pd
import pytest
from locomotive_day import CYCLE_S, RAIL, STEP_S, leading_axle, locomotive_day, peak


@pytest.fixture(scope="module")
def day():
    return locomotive_day(5, 2 * CYCLE_S)


def test_the_train_obeys_newton(day):
    """The change of momentum over any ten seconds is the impulse of all forces."""
    signals = day.signals
    force = signals["adhesion_force_N"] - signals["resistance_N"]
    impulse = np.concatenate([[0.0], np.cumsum((force[1:].to_numpy() + force[:-1]) / 2 * STEP_S)])
    lag = round(10 / STEP_S)
    gained = day.truth["train_mass_kg"] * signals["speed_mps"].diff(lag).dropna()
    expected = impulse[lag:] - impulse[:-lag]
    # The forces act at the start of a step, so that half a step of their change is left over.
    half_step = STEP_S / 2 * np.abs(force.to_numpy()[lag:] - force.to_numpy()[:-lag])
    assert (np.abs(gained - expected) < half_step + 1.0).all()
    assert np.abs(expected).max() > 1e5


def test_the_logged_forces_less_inertia_move_the_train(day):
    """From the logs alone: what the motors give, less what spins up the wheelsets."""
    spinning = day.truth["inertia_kgm2"] / day.truth["radius_m"] ** 2
    rows = slice(1000, -1000)
    given = sum(log["axle_force_N"].to_numpy()[rows].mean() for log in day.axles)
    lasts = (len(day.axles[0]) - 2001) * STEP_S
    spun = sum(
        spinning * (signal.iloc[-1001] - signal.iloc[1000]) / lasts
        for signal in (day.signals[f"tread_mps_{axle}"] for axle in range(1, 5))
    )
    late = round(day.truth["delay_s"] / STEP_S)
    speed = day.axles[0]["vehicle_speed_mps"].shift(-late)
    moved = day.truth["train_mass_kg"] * (speed.iloc[-1001] - speed.iloc[1000]) / lasts
    outer = day.signals["resistance_N"][rows].mean()
    # Noise: 900 N a row and axle, and 2 cm/s a speed before its mean over 21 rows.
    error = np.hypot(
        2 * 900 / np.sqrt(len(day.axles[0]) - 2000),
        np.sqrt(2 / 21) * 0.02 * day.truth["train_mass_kg"] / lasts,
    )
    assert given - spun - outer == pytest.approx(moved, abs=4 * error)
    assert outer > 100 * error


def test_every_axle_finds_the_adhesion_of_the_law(day):
    signals, log = day.signals, day.axles[0]
    spinning = day.truth["inertia_kgm2"] / day.truth["radius_m"] ** 2
    for axle, factor in enumerate(day.truth["axle_factors"], 1):
        tread = signals[f"tread_mps_{axle}"]
        force = signals[f"force_N_{axle}"] - spinning * tread.diff() / STEP_S
        slip = tread / signals["speed_mps"] - 1
        level, rate, share, fall = np.array([RAIL[rail] for rail in log["rail_state"]]).T
        size = slip.abs()
        law = level * (1 - np.exp(-rate * size)) * (share * np.exp(-size / fall) + 1 - share)
        law *= np.sign(slip) * 1.12 / (1 + 0.0045 * 3.6 * signals["speed_mps"])
        found = force / signals[f"load_N_{axle}"] / (factor * (1 + signals["level"]))
        np.testing.assert_allclose(found[1:], law[1:], atol=1e-5)


def test_slip_events_pass_the_peak_and_end(day):
    signals = day.signals
    assert len(day.truth["events_s"]) == 2
    for axle in range(1, 5):
        slip = signals[f"tread_mps_{axle}"] / signals["speed_mps"] - 1
        outside = pd.Series(True, signals.index)
        for start, end in day.truth["events_s"]:
            inside = (signals["time_s"] >= start) & (signals["time_s"] <= end + 3)
            assert 0.045 < slip[inside].max() < 0.13
            outside &= ~inside
        assert slip[outside].abs().max() < 0.01
    braking = signals["adhesion_force_N"] < -5000
    assert braking.any()
    loads = signals[[f"load_N_{axle}" for axle in range(1, 5)]].sum(axis=1)
    np.testing.assert_allclose(loads, 4 * day.truth["static_axle_load_N"])


def test_the_radar_is_late_and_the_encoder_is_noisy(day):
    log, signals = day.axles[2], day.signals
    true = signals["speed_mps"].to_numpy()
    told = log["vehicle_speed_mps"].to_numpy()
    misfit = [np.square(told[50:] - true[50 - lag : true.size - lag]).mean() for lag in range(50)]
    assert np.argmin(misfit) == pytest.approx(day.truth["delay_s"] / STEP_S, abs=2)
    noise = log["wheel_speed_mps"] - signals["tread_mps_3"]
    assert noise.std() == pytest.approx(0.01, rel=4 / np.sqrt(2 * len(noise)))
    assert set(log["rail_state"]) <= {"dry", "wet"}


def test_peaks_fall_with_speed_and_on_wet_rail():
    frame, truth = leading_axle(1, 30.0)
    assert len(frame) == 3000
    slip = np.linspace(0.0, 0.2, 200_001)
    for (rail, kmh), (slip_opt, mu_max) in truth["peaks"].items():
        level, rate, share, fall = RAIL[rail]
        law = level * (1 - np.exp(-rate * slip)) * (share * np.exp(-slip / fall) + 1 - share)
        law *= 0.88 * 1.12 / (1 + 0.0045 * kmh)
        assert mu_max == pytest.approx(law.max(), rel=1e-8)
        assert slip_opt == pytest.approx(slip[law.argmax()], abs=3e-6)
    assert peak(60, "dry", axle=3)[1] == pytest.approx(truth["peaks"]["dry", 60][1] / 0.88)
