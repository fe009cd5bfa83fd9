"""A curve with its departure: its values, its derivatives, its peak, and its file."""

import json

import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.curves import CURVES, adhesion_of, free_values, with_free_values
from adhesion_jax.curves.bent import FUNCTIONS, Bent
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.saved import load_law, save_law
from adhesion_jax.errors import InputError
from adhesion_jax.inference.law import FittedLaw, Span, peak_of

REACH, LARGEST = 0.004, 0.15
SPAN = Span(REACH, LARGEST)

#: A smooth departure of some per cent.
FACTORS = np.array([0.12, -0.08, 0.05, -0.02, 0.015, -0.01, 0.008, 0.0, -0.004, 0.002])
FACTORS = np.append(FACTORS, 0.001 * (-0.7) ** np.arange(FUNCTIONS - FACTORS.size))

#: The conditions of the curves that need any.
CONDITIONS = {"vehicle_speed_mps": 12.0, "normal_load_N": 80e3}

NAMES = sorted(CURVES)


def by_hand(slip, factors=FACTORS):
    """The departure by its formula."""
    size = np.minimum(np.abs(slip), LARGEST)
    u = np.log(1 + size / REACH) / np.log(1 + LARGEST / REACH)
    return sum(b * np.sin(np.pi * (j - 0.5) * u) for j, b in enumerate(factors, 1))


def law_of(name, factors=FACTORS):
    curve = CURVES[name]
    parameters = np.append(np.asarray(free_values(curve)), factors)
    return FittedLaw(curve, parameters, SPAN, {need: CONDITIONS[need] for need in curve.NEEDS})


def adhesion_by_hand(law, slip):
    """The curve itself, times one and the departure by its formula."""
    count = len(law.curve.free)
    curve = with_free_values(law.curve, law.parameters[:count])
    bare = np.asarray(adhesion_of(curve, slip, law.conditions))
    return bare * (1 + by_hand(slip, law.parameters[count:]))


def highest(law, limit):
    """Slip and size of the largest adhesion, by grids that close in on it."""
    low, high = 0.0, limit
    for _ in range(3):
        slip = np.linspace(low, high, 20_001)
        heights = adhesion_by_hand(law, slip)
        top = int(np.argmax(heights))
        low, high = slip[max(top - 20, 0)], slip[min(top + 20, 20_000)]
    return slip[top], heights[top]


def differences(of, at, step=1e-5):
    """Central differences, by each coordinate."""
    at = np.asarray(at, dtype=float)
    steps = np.diag(step * np.maximum(np.abs(at), 1e-2))
    return np.array([(of(at + one) - of(at - one)) / (2 * one.sum()) for one in steps])


@pytest.mark.parametrize("name", NAMES)
def test_without_factors_it_is_the_curve_to_the_last_bit(name):
    curve = CURVES[name]
    slip = np.geomspace(1e-5, 1, 40)
    slip = np.concatenate([-slip, [0.0], slip])
    bent = Bent(curve, np.zeros(FUNCTIONS), REACH, LARGEST)
    np.testing.assert_array_equal(
        bent(jnp.asarray(slip), CONDITIONS), curve(jnp.asarray(slip), CONDITIONS)
    )


@pytest.mark.parametrize("name", NAMES)
def test_the_law_is_the_curve_times_its_departure(name):
    law = law_of(name)
    slip = np.concatenate([-np.geomspace(1e-4, 0.3, 30), np.geomspace(1e-4, 0.3, 30)])
    truth = adhesion_by_hand(law, slip)
    np.testing.assert_allclose(law.bent(jnp.asarray(slip), law.conditions), truth, rtol=1e-12)
    np.testing.assert_allclose(law.at(slip).adhesion, truth, rtol=1e-12)
    np.testing.assert_allclose(law.bent.departure(slip), by_hand(slip), rtol=1e-12)


def test_at_slip_zero_there_is_neither_adhesion_nor_departure():
    bent = law_of("polach").bent
    assert float(bent(jnp.asarray(0.0), {})) == 0.0
    assert float(bent.departure(0.0)) == 0.0


def test_beyond_the_largest_slip_the_departure_stays():
    bent = law_of("polach").bent
    beyond = np.asarray(bent.departure(LARGEST * np.array([1.0, 1.01, 2.0, 50.0, -3.0])))
    # The functions are 1 and -1 by turns there.
    np.testing.assert_allclose(beyond, FACTORS @ (-1.0) ** np.arange(FUNCTIONS), rtol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_derivatives_are_those_of_differences(name):
    law = law_of(name)
    slip = np.array([-0.03, 0.0007, 0.004, 0.02, 0.08, 0.14, 0.3])
    found = law.at(slip)
    by_parameter = differences(
        lambda parameters: adhesion_by_hand(law._replace(parameters=parameters), slip),
        law.parameters,
    )
    scale = np.abs(by_parameter).max(axis=1)
    np.testing.assert_allclose(found.by_parameter / scale, by_parameter.T / scale, atol=1e-6)
    step = 1e-7
    rise = adhesion_by_hand(law, slip + step) - adhesion_by_hand(law, slip - step)
    np.testing.assert_allclose(found.by_slip, rise / (2 * step), rtol=1e-5, atol=1e-6)


def test_points_are_evaluated_alike_however_many_there_are():
    law = law_of("polach")
    slip = np.linspace(-0.2, 0.2, 20_001)
    np.testing.assert_allclose(law.at(slip).adhesion, adhesion_by_hand(law, slip), rtol=1e-12)
    few = law.at(slip[:3]).by_parameter
    np.testing.assert_allclose(law.at(slip).by_parameter[:3], few, rtol=1e-12)


def test_the_mean_over_a_noisy_slip_is_that_of_the_normal_distribution():
    law = law_of("polach")
    slip, spread = np.array([0.03, 0.06, 0.1]), np.array([0.004, 0.008, 0.0])
    found = law.at(slip, spread)
    z = np.linspace(-6, 6, 4001)
    density = np.exp(-0.5 * z**2) / np.exp(-0.5 * z**2).sum()
    truth = adhesion_by_hand(law, slip[:, None] + spread[:, None] * z) @ density
    blunted = truth - adhesion_by_hand(law, slip)
    assert np.all(np.abs(blunted[:2]) > 1e-5)
    assert np.all(np.abs(found.adhesion - truth) < 0.05 * np.abs(blunted) + 1e-12)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_the_peak_is_that_of_a_grid(name, scale):
    law, limit = law_of(name, scale * FACTORS), 0.5
    slip, adhesion = highest(law, limit)
    found = peak_of(law, limit)
    of_law = law.bent.peak(law.conditions, limit)
    assert found.found == bool(of_law.found) == (slip < 0.999 * limit)
    assert found.adhesion == pytest.approx(adhesion, rel=1e-6)
    assert float(of_law.adhesion) == pytest.approx(adhesion, rel=1e-6)
    assert found.slip == pytest.approx(slip, rel=1e-6)
    assert float(of_law.slip) == pytest.approx(slip, rel=1e-6)


def test_a_curve_that_is_highest_at_the_end_has_no_peak():
    """The curve and its departure both rise."""
    factors = np.append(0.2, np.zeros(FUNCTIONS - 1))
    law = law_of("polach", factors)
    found = peak_of(law, 0.1)
    assert not found.found
    assert found.slip == pytest.approx(0.1)
    assert found.adhesion == pytest.approx(float(adhesion_by_hand(law, np.array([0.1]))[0]))


@pytest.mark.parametrize("name", ["burckhardt", "polach-falling", "magic-formula"])
def test_derivatives_of_the_peak_are_those_of_differences(name):
    law = law_of(name)
    found = peak_of(law, 0.5)
    assert found.found

    def peak(parameters):
        """Of a parabola through the adhesion near the peak, which rounding does not move."""
        near = found.slip * np.linspace(0.98, 1.02, 21)
        heights = adhesion_by_hand(law._replace(parameters=parameters), near)
        fit = np.polynomial.Polynomial.fit(near, heights, 6)
        roots = fit.deriv().roots()
        real = roots[np.abs(roots.imag) < 1e-9].real
        at = real[np.argmin(np.abs(real - found.slip))]
        return np.array([at, fit(at)])

    truth = differences(peak, law.parameters, 1e-4).T
    np.testing.assert_allclose(found.by_slip, truth[0], rtol=1e-3, atol=1e-3 * np.ptp(truth[0]))
    np.testing.assert_allclose(found.by_law, truth[1], rtol=1e-4, atol=1e-5 * np.ptp(truth[1]))


@pytest.mark.parametrize("name", NAMES)
def test_a_saved_law_with_a_departure_is_read_as_it_was(name, tmp_path):
    law = CorrectedLaw(law_of(name).bent, (), {}, Calendar("run_order", 0.0, 1.0))
    save_law(tmp_path / "law.json", law)
    read = load_law(tmp_path / "law.json")
    assert isinstance(read.curve, Bent)
    slip = jnp.asarray(np.linspace(-0.3, 0.3, 61))
    np.testing.assert_array_equal(read(slip, CONDITIONS), law(slip, CONDITIONS))
    assert read.calendar == law.calendar


@pytest.mark.parametrize(
    ("name", "number"),
    [
        ("factors", []),
        ("factors", [[0.1]]),
        ("factors", 0.1),
        ("factors", [float("nan")] * FUNCTIONS),
        ("reach", 0.0),
        ("reach", None),
        ("largest", -1.0),
        ("width", 1.0),
    ],
)
def test_a_file_whose_departure_is_none_is_refused_in_one_sentence(name, number, tmp_path):
    path = tmp_path / "law.json"
    save_law(path, CorrectedLaw(law_of("polach").bent, (), {}, Calendar("run_order", 0.0, 1.0)))
    saved = json.loads(path.read_text())
    saved["departure"][name] = number
    path.write_text(json.dumps(saved))
    with pytest.raises(InputError) as refused:
        load_law(path)
    sentence = str(refused.value)
    assert str(path) in sentence
    assert sentence.endswith(".")
    assert "\n" not in sentence
    assert ". " not in sentence
