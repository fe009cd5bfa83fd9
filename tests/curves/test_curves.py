import csv
import dataclasses
import functools
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from adhesion_jax.curves import (
    BASES,
    CURVES,
    SLIP_LIMIT,
    free_values,
    physical_box,
    with_free_values,
)
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.exponential import Exponential
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.curves.magic_formula import MagicFormula
from adhesion_jax.curves.peak import find_peak
from adhesion_jax.curves.polach import Polach, PolachFalling
from adhesion_jax.curves.similar import Similar

CONDITIONS = {"vehicle_speed_mps": 15.0, "normal_load_N": 1.0e5}

ALL = {
    **CURVES,
}

#: Curves with a peak inside the range, near and far from rest, sharp and flat.
PEAKED = {
    "burckhardt-dry": Burckhardt(c1=0.8287, c2=45.45, c3=0.4),
    "burckhardt-common": Burckhardt(c1=0.32, c2=25.0, c3=0.1),
    "burckhardt-wet": Burckhardt(c1=0.165, c2=15.0, c3=0.1),
    "burckhardt-steep": Burckhardt(c1=0.3, c2=3000.0, c3=2.0),
    "kiencke-dry": Kiencke(a0=40.0, p1=31.29, p2=100.0),
    "kiencke-common": Kiencke(a0=40.0, p1=122.6, p2=32.55),
    "kiencke-overshoot": Kiencke(a0=2.0, p1=-1.5, p2=4.0),
    "exponential": Exponential(a=1.0, b=100.0, c=0.3),
    "exponential-close": Exponential(a=5.0, b=5.1, c=1.0),
    "polach-falling": PolachFalling(mu0=0.4, a=0.4, b=0.6, stiffness=150.0, k_s=0.4),
    "polach-falling-wet": PolachFalling(mu0=0.25, a=0.3, b=0.1, stiffness=30.0, k_s=0.7),
    "polach-falling-stiff": PolachFalling(mu0=0.5, a=0.4, b=0.6, stiffness=3000.0, k_s=0.2),
    "magic-formula": MagicFormula(b=100.0, c=1.5, d=0.3, e=0.0),
    "magic-formula-curved": MagicFormula(b=10.0, c=1.3, d=0.6, e=-2.0),
    "magic-formula-late": MagicFormula(b=3.0, c=1.7, d=0.6, e=0.1),
    "similar": Similar(Exponential(a=1.0, b=2.2, c=1.0), level=1.3, stretch=0.3),
    "similar-numeric": Similar(MagicFormula(b=10.0, c=1.3, d=0.6, e=-2.0), level=0.5, stretch=0.2),
}

#: Curves without a peak between slip 0 and 1, and the end of the range where they are largest.
PEAKLESS = {
    "burckhardt-rises": (Burckhardt(c1=0.3, c2=0.6, c3=0.01), 1.0),
    "burckhardt-no-fall": (Burckhardt(c1=0.3, c2=20.0, c3=0.0), 1.0),
    "burckhardt-falls": (Burckhardt(c1=0.01, c2=1.0, c3=0.5), 0.0),
    "kiencke-rises": (Kiencke(a0=1.0, p1=2.0, p2=0.5), 1.0),
    "kiencke-flat": (Kiencke(a0=1.0, p1=2.0, p2=0.0), 1.0),
    "exponential-rises": (Exponential(a=0.1, b=0.5, c=0.3), 1.0),
    "exponential-negative": (Exponential(a=10.0, b=5.0, c=0.3), 0.0),
    "exponential-zero": (Exponential(a=10.0, b=10.0, c=0.3), 0.0),
    "polach": (Polach(mu0=0.33, stiffness=100.0), 1.0),
    "similar-late": (Similar(Exponential(a=1.0, b=2.2, c=1.0), level=1.3, stretch=2.0), 1.0),
    "polach-falling-none": (PolachFalling(mu0=0.4, a=1.0, b=0.6, stiffness=150.0, k_s=0.4), 1.0),
    "magic-formula-rises": (MagicFormula(b=10.0, c=0.9, d=0.6, e=0.0), 1.0),
    "magic-formula-slow": (MagicFormula(b=0.1, c=1.5, d=0.6, e=0.0), 1.0),
}


def adhesion(curve, slip, conditions=CONDITIONS):
    return np.asarray(curve(jnp.asarray(slip, dtype=float), conditions))


# Without optimisation: many small programs, each run a few times.
quick_jit = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


@quick_jit
def _peak(curve, conditions, slip_limit):
    return curve.peak(conditions, slip_limit)


def peak_of(curve, slip_limit=SLIP_LIMIT):
    """The peak, compiled once a form of curve."""
    return _peak(curve, CONDITIONS, slip_limit)


@pytest.mark.parametrize("name", PEAKED)
def test_the_peak_is_the_largest_adhesion_and_its_slope_is_zero(name):
    curve = PEAKED[name]
    peak = peak_of(curve)
    slip, top = float(peak.slip), float(peak.adhesion)
    assert bool(peak.found)
    assert 0 < slip <= SLIP_LIMIT
    assert top == pytest.approx(float(adhesion(curve, slip)), rel=1e-13)
    grid = np.concatenate([np.linspace(0, 1, 100_001), slip * np.linspace(0.9, 1.1, 2001)])
    assert np.max(adhesion(curve, grid[grid <= 1])) <= top * (1 + 1e-12)
    initial_slope = float(adhesion(curve, 1e-9)) / 1e-9
    assert abs(float(jax.grad(lambda s: curve(s, CONDITIONS))(peak.slip))) < 1e-8 * initial_slope
    found = minimize_scalar(
        lambda s: -float(adhesion(curve, s)),
        bounds=(0.5 * slip, min(1.5 * slip, 1.0)),
        method="bounded",
        options={"xatol": 1e-10},
    )
    # A maximum is flat: its place is known to the root of the precision of its value.
    assert slip == pytest.approx(found.x, rel=1e-5)
    assert top == pytest.approx(-found.fun, rel=1e-12)


@pytest.mark.parametrize(
    ("curve", "slip", "top"),
    [
        (Burckhardt(c1=0.8287, c2=45.45, c3=0.4), 0.1000, 0.7799),
        (Burckhardt(c1=0.32, c2=25.0, c3=0.1), 0.1753, 0.2985),
        (Burckhardt(c1=0.165, c2=15.0, c3=0.1), 0.2139, 0.1369),
        # Matched to the same peaks.
        (Kiencke(a0=40.0, p1=31.29, p2=100.0), 0.1000, 0.7799),
        (Kiencke(a0=40.0, p1=122.6, p2=32.55), 0.1753, 0.2985),
        (Kiencke(a0=40.0, p1=282.7, p2=21.85), 0.2139, 0.1369),
    ],
)
def test_peaks_of_the_published_rails(curve, slip, top):
    peak = curve.peak({})
    assert float(peak.slip) == pytest.approx(slip, abs=1e-4)
    assert float(peak.adhesion) == pytest.approx(top, abs=1e-4)


@pytest.mark.parametrize("name", PEAKLESS)
def test_no_peak_is_an_answer(name):
    curve, end = PEAKLESS[name]
    peak = peak_of(curve)
    assert not bool(peak.found)
    assert float(peak.slip) == end
    assert float(peak.adhesion) == pytest.approx(float(adhesion(curve, end)), abs=1e-15)
    assert np.max(adhesion(curve, np.linspace(0, 1, 10_001))) <= float(peak.adhesion) + 1e-15


@pytest.mark.parametrize("p2", [1e-3, 0.01, 0.8, 1.0, 30.0, 1e6])
def test_within_its_box_kiencke_has_no_pole(p2):
    """Fitted to few slips that adhesion rises between, it had one where no point lies."""
    curve = Kiencke(a0=1.0, p1=Kiencke.PARAMETERS["p1"].lower, p2=p2)
    slip = jnp.linspace(0.0, 40.0, 400_001)
    adhesion = np.asarray(curve(slip, {}))
    assert (adhesion[1:] > 0).all()
    # Nowhere is it steeper than at slip 0, so that it cannot jump.
    assert (np.diff(adhesion) <= 1.0001 * float(slip[1])).all()


@pytest.mark.parametrize(("p1", "found"), [(-5.0, False), (-4.04, False), (-3.96, True)])
def test_a_kiencke_curve_with_a_pole_in_the_range_has_no_peak(p1, found):
    """Its denominator has a root where p1 < -2 sqrt(p2)."""
    peak = Kiencke(a0=1.0, p1=p1, p2=4.0).peak({})
    assert bool(peak.found) == found
    assert np.isfinite(peak.slip)
    assert np.isfinite(peak.adhesion)


@pytest.mark.parametrize("name", PEAKED)
def test_a_peak_beyond_the_largest_slip_is_not_found(name):
    curve = PEAKED[name]
    slip = float(peak_of(curve).slip)
    short = peak_of(curve, 0.9 * slip)
    assert not bool(short.found)
    assert float(short.slip) == pytest.approx(0.9 * slip, rel=1e-13)
    long = peak_of(curve, 1.02 * slip)
    assert bool(long.found)
    assert float(long.slip) == pytest.approx(slip, rel=1e-7)


@quick_jit
def numeric_peak(curve):
    return find_peak(lambda slip: curve(slip, {}), SLIP_LIMIT)


def test_the_numeric_peak_agrees_with_the_closed_form():
    for name in ("burckhardt-dry", "burckhardt-steep", "kiencke-overshoot", "exponential-close"):
        curve = PEAKED[name]
        closed, numeric = curve.peak({}), numeric_peak(curve)
        assert bool(numeric.found), name
        assert float(numeric.slip) == pytest.approx(float(closed.slip), rel=1e-8), name
        assert float(numeric.adhesion) == pytest.approx(float(closed.adhesion), rel=1e-13), name


def test_speed_bends_the_curve_that_knows_it():
    falling = PEAKED["polach-falling"]
    peak = quick_jit(lambda speed: falling.peak({"vehicle_speed_mps": speed}))
    slow, fast = map(peak, (5.0, 50.0))
    assert float(fast.slip) < float(slow.slip)
    assert float(fast.adhesion) < float(slow.adhesion)


def stacked(curve, values):
    """The free parameters' peak as one array: slip, adhesion."""
    peak = with_free_values(curve, values).peak(CONDITIONS)
    return jnp.stack([peak.slip, peak.adhesion])


# Like the peak compiled once a form of curve.
@quick_jit
def with_derivative(curve, values):
    return stacked(curve, values), jax.jacfwd(lambda v: stacked(curve, v))(values)


@quick_jit
def derivative_of_the_end(curve, values):
    def short(v):
        return with_free_values(curve, v).peak(CONDITIONS, 1e-4).adhesion

    return jax.jacfwd(short)(values)


@pytest.mark.parametrize("name", [n for n in PEAKED if n not in ("exponential-close",)])
def test_the_derivative_of_the_peak_agrees_with_finite_differences(name):
    curve = PEAKED[name]
    values = np.asarray(free_values(curve))
    at, derivative = map(np.asarray, with_derivative(curve, jnp.asarray(values)))
    scale = at[:, None] / np.where(values == 0, 1.0, values)
    for j, value in enumerate(values):
        if value == 0:
            continue  # c3 = 0 lies on its bound: there is no difference on both sides.
        step = np.zeros_like(values)
        step[j] = 1e-5 * value
        above, below = (
            np.asarray(with_derivative(curve, jnp.asarray(v))[0])
            for v in (values + step, values - step)
        )
        difference = (above - below) / (2e-5 * value)
        np.testing.assert_allclose(
            derivative[:, j] / scale[:, j], difference / scale[:, j], atol=2e-6
        )

    # Without a peak the derivative is that of the adhesion at the end: finite, not a NaN.
    assert np.all(np.isfinite(derivative_of_the_end(curve, jnp.asarray(values))))


@pytest.mark.parametrize("name", PEAKLESS)
def test_derivatives_stay_finite_where_there_is_no_peak(name):
    curve, _ = PEAKLESS[name]
    _, derivative = with_derivative(curve, free_values(curve))
    assert np.all(np.isfinite(derivative))


SLIPS = np.concatenate([-np.geomspace(1e-3, 0.9, 9), np.geomspace(1e-4, 1.0, 15)])


@pytest.mark.parametrize("name", ALL)
def test_sensitivities_agree_with_finite_differences(name):
    curve = ALL[name]
    values = np.asarray(free_values(curve))
    model = quick_jit(lambda v: with_free_values(curve, v)(jnp.asarray(SLIPS), CONDITIONS))
    sensitivity = np.asarray(jax.jacfwd(model)(jnp.asarray(values)))
    for j, value in enumerate(values):
        step = np.zeros_like(values)
        size = 1e-5 * (abs(value) or 1.0)
        step[j] = size
        above, below = model(jnp.asarray(values + step)), model(jnp.asarray(values - step))
        difference = (above - below) / (2 * size)
        largest = np.max(np.abs(sensitivity[:, j]))
        assert largest > 0
        np.testing.assert_allclose(sensitivity[:, j], difference, rtol=1e-6, atol=1e-7 * largest)


def test_sensitivities_of_burckhardt_and_kiencke_are_the_published_ones():
    slip = np.linspace(0.001, 0.5, 40)
    c1, c2, c3 = 0.8287, 45.45, 0.4

    def g(slip):
        decay = np.exp(-c2 * slip)
        return np.stack([1 - decay, c1 * slip * decay, -slip], axis=-1)

    def burckhardt(v):
        return Burckhardt(v[0], v[1], v[2])

    at = jnp.array([c1, c2, c3])
    np.testing.assert_allclose(
        jax.jacfwd(lambda v: burckhardt(v)(jnp.asarray(slip), {}))(at), g(slip), rtol=1e-10
    )
    peak = np.log(c1 * c2 / c3) / c2
    np.testing.assert_allclose(
        jax.jacfwd(lambda v: burckhardt(v).peak({}).adhesion)(at), g(peak), rtol=1e-10
    )
    np.testing.assert_allclose(
        jax.jacfwd(lambda v: burckhardt(v).peak({}).slip)(at),
        [1 / (c1 * c2), (1 / c2 - peak) / c2, -1 / (c2 * c3)],
        rtol=1e-10,
    )
    a0, p1, p2 = 40.0, 31.29, 100.0
    denominator = 1 + p1 * slip + p2 * slip**2
    np.testing.assert_allclose(
        jax.jacfwd(lambda v: Kiencke(a0, v[0], v[1])(jnp.asarray(slip), {}))(jnp.array([p1, p2])),
        np.stack([-a0 * slip**2, -a0 * slip**3], axis=-1) / denominator[:, None] ** 2,
        rtol=1e-10,
    )


def logarithmic(low, high):
    return st.floats(np.log(low), np.log(high)).map(lambda t: float(np.exp(t)))


def form(curve, **parameters):
    # Built in the test, not here: the type checker draws random numbers, hypothesis objects.
    return st.tuples(st.just(curve), st.fixed_dictionaries(parameters))


def build(drawn):
    curve, parameters = drawn
    return curve(**parameters)


#: Any curve of each form, over much of its physical range, none with a pole.
BURCKHARDT = form(
    Burckhardt, c1=logarithmic(0.01, 2), c2=logarithmic(1, 3000), c3=logarithmic(1e-3, 5)
)
KIENCKE = form(
    Kiencke, a0=logarithmic(0.1, 2000), p1=logarithmic(0.1, 5000), p2=logarithmic(1e-2, 1e6)
)
EXPONENTIAL = form(
    Exponential, a=logarithmic(1e-3, 50), b=logarithmic(60, 5000), c=logarithmic(0.01, 5)
)
POLACH = form(Polach, mu0=logarithmic(0.01, 2), stiffness=logarithmic(0.1, 5000))
POLACH_FALLING = form(
    PolachFalling,
    mu0=logarithmic(0.01, 2),
    a=st.floats(0.05, 1),
    b=logarithmic(0.01, 20),
    stiffness=logarithmic(0.1, 5000),
    k_s=logarithmic(0.1, 1),
)
MAGIC = form(
    MagicFormula,
    b=logarithmic(0.1, 5000),
    c=st.floats(0.5, 2),
    d=logarithmic(0.01, 2),
    e=st.floats(-20, 1),
)
ANY = st.one_of(BURCKHARDT, KIENCKE, EXPONENTIAL, POLACH, POLACH_FALLING, MAGIC)
SLIP = np.geomspace(1e-7, 1.0, 50)


def bound_of(curve):
    """A bound of |adhesion| for |slip| <= 1, from the equation of each curve."""
    match curve:
        case Burckhardt():
            return max(curve.c1, curve.c3)
        case Kiencke():
            return curve.a0 / (curve.p1 + 2 * curve.p2**0.5)
        case Exponential():
            return curve.c
        case Polach():
            return curve.mu0
        case PolachFalling():
            # e/(1 + e^2) is at most 1/2, the arctangent pi/2.
            return curve.mu0 * (1 + 1 / np.pi)
        case MagicFormula():
            return curve.d
    raise AssertionError(curve)


@given(ANY)
def test_adhesion_is_odd_zero_at_rest_and_bounded(drawn):
    curve = build(drawn)
    forwards, backwards = adhesion(curve, SLIP), adhesion(curve, -SLIP)
    np.testing.assert_array_equal(forwards, -backwards)
    assert float(adhesion(curve, 0.0)) == 0.0
    assert np.all(np.abs(forwards) <= bound_of(curve) * (1 + 1e-12))
    assert np.all(forwards[:1] > 0) or isinstance(curve, Burckhardt)


@given(ANY)
def test_the_peak_of_any_curve_is_finite_and_the_largest(drawn):
    curve = build(drawn)
    peak = peak_of(curve)
    top = float(peak.adhesion)
    assert 0 <= float(peak.slip) <= SLIP_LIMIT
    scale = bound_of(curve)
    assert np.max(adhesion(curve, np.linspace(0, 1, 2001))) <= top + 1e-9 * scale
    assert np.max(adhesion(curve, SLIP)) <= top + 1e-9 * scale
    assert top == pytest.approx(float(adhesion(curve, float(peak.slip))), rel=1e-12)


#: The power of one over slip in the unit of each parameter.
PER_SLIP = {
    Burckhardt: {"c2": 1, "c3": 1},
    Kiencke: {"a0": 1, "p1": 1, "p2": 2},
    Exponential: {"a": 1, "b": 1},
    Polach: {"stiffness": 1},
    PolachFalling: {"stiffness": 1, "b": 1},
    MagicFormula: {"b": 1},
}


@given(ANY)
def test_slip_in_per_cent_with_rescaled_parameters_gives_the_same_adhesion(drawn):
    curve = build(drawn)
    powers = PER_SLIP[type(curve)]
    scaled = {name: getattr(curve, name) * 0.01**power for name, power in powers.items()}
    per_cent = dataclasses.replace(curve, **scaled)
    np.testing.assert_allclose(
        adhesion(per_cent, 100 * SLIP), adhesion(curve, SLIP), rtol=1e-11, atol=1e-15
    )
    peak, peak_per_cent = peak_of(curve), peak_of(per_cent, 100 * SLIP_LIMIT)
    assert bool(peak.found) == bool(peak_per_cent.found)
    assert float(peak_per_cent.adhesion) == pytest.approx(float(peak.adhesion), rel=1e-9)


#: The parameters that are levels of adhesion: times k, they give k times the adhesion.
LEVELS = {
    Burckhardt: ("c1", "c3"),
    Kiencke: ("a0",),
    Exponential: ("c",),
    Polach: ("mu0", "stiffness"),
    PolachFalling: ("mu0", "stiffness"),
    MagicFormula: ("d",),
}


@given(ANY, logarithmic(0.1, 10))
def test_the_level_scales_the_adhesion_and_leaves_the_peaks_slip(drawn, factor):
    curve = build(drawn)
    levels = {name: factor * getattr(curve, name) for name in LEVELS[type(curve)]}
    higher = dataclasses.replace(curve, **levels)
    np.testing.assert_allclose(
        adhesion(higher, SLIP), factor * adhesion(curve, SLIP), rtol=1e-10, atol=1e-15
    )
    peak, high = peak_of(curve), peak_of(higher)
    assert float(high.adhesion) == pytest.approx(factor * float(peak.adhesion), rel=1e-9)


@pytest.mark.parametrize("name", ALL)
def test_curves_broadcast_over_shapes_conditions_and_batches(name):
    curve = ALL[name]
    flat = np.linspace(-0.3, 0.3, 24)
    expected = adhesion(curve, flat)
    for shape in ((24,), (2, 12), (2, 3, 4), (24, 1)):
        found = adhesion(curve, flat.reshape(shape))
        assert found.shape == shape
        np.testing.assert_array_equal(found.ravel(), expected)
    assert adhesion(curve, 0.1).shape == ()
    assert adhesion(curve, np.zeros(0)).shape == (0,)
    columns = {key: jnp.full(24, value) for key, value in CONDITIONS.items()}
    np.testing.assert_allclose(adhesion(curve, flat, columns), expected, rtol=1e-13)
    values = jnp.stack([free_values(curve), 1.1 * free_values(curve)])
    batch = jax.vmap(lambda v: with_free_values(curve, v)(jnp.asarray(flat), CONDITIONS))(values)
    np.testing.assert_allclose(batch[0], expected, rtol=1e-13)
    peaks = quick_jit(jax.vmap(lambda v: with_free_values(curve, v).peak(CONDITIONS)))(values)
    assert peaks.slip.shape == peaks.adhesion.shape == (2,)
    assert float(peaks.adhesion[0]) == pytest.approx(float(peak_of(curve).adhesion))


@pytest.mark.parametrize("name", ALL)
def test_every_parameter_is_described_and_the_values_lie_inside_their_bounds(name):
    curve = ALL[name]
    fields = {field.name for field in dataclasses.fields(curve)} - {"free"}
    assert set(curve.PARAMETERS) == fields
    assert set(curve.free) <= fields
    for parameter in curve.PARAMETERS.values():
        assert parameter.lower < parameter.upper
        assert parameter.unit
        assert parameter.meaning
        assert parameter.source
    lower, upper = physical_box(curve)
    values = free_values(curve)
    assert lower.shape == upper.shape == values.shape == (len(curve.free),)
    assert np.all(values > lower)
    assert np.all(values < upper)
    for j, field in enumerate(curve.free):
        assert float(lower[j]) == curve.PARAMETERS[field].lower
        assert float(upper[j]) == curve.PARAMETERS[field].upper
        assert float(values[j]) == getattr(curve, field)


@pytest.mark.parametrize("name", ALL)
def test_curves_need_the_conditions_they_name_and_no_others(name):
    curve = ALL[name]
    needed = {key: CONDITIONS[key] for key in curve.NEEDS}
    np.testing.assert_array_equal(adhesion(curve, SLIP, needed), adhesion(curve, SLIP))
    for key in curve.NEEDS:
        with pytest.raises(KeyError, match=key):
            adhesion(curve, SLIP, {k: v for k, v in needed.items() if k != key})


def test_free_values_go_out_and_back_in_the_order_of_free():
    curve = Kiencke(a0=40.0, p1=31.29, p2=100.0)
    assert list(free_values(curve)) == [31.29, 100.0]
    changed = with_free_values(curve, jnp.array([1.0, 2.0]))
    assert (float(changed.a0), float(changed.p1), float(changed.p2)) == (40.0, 1.0, 2.0)
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        with_free_values(curve, jnp.array([1.0]))


def contact(series):
    path = Path(__file__).parents[1] / "truth" / "contact_eurosprinter_curves.csv"
    with open(path, newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["series"] == series]
    return np.array([[float(row["creepage"]), float(row["adhesion"])] for row in rows]).T


def test_polachs_closed_form_lies_near_rolling_contact_theory():
    creepage, truth = contact("contact_coulomb")
    assert creepage.size == 30
    curve = Polach(mu0=0.33, stiffness=float(truth[0] / creepage[0]))
    error = adhesion(curve, creepage) / truth - 1
    assert np.max(np.abs(error)) < 0.06


def test_the_stiffness_of_polach_is_the_slope_at_slip_zero():
    curve = Polach(mu0=0.33, stiffness=150.0)
    assert adhesion(curve, 1e-9) / 1e-9 == pytest.approx(150.0, rel=1e-6)


@pytest.mark.parametrize("name", BASES)
def test_a_fit_begins_inside_the_bounds_near_the_largest_adhesion(name):
    curve, top = BASES[name], 0.25
    for start in type(curve).starts(top):
        assert len(start) == len(curve.free)
        begun = dataclasses.replace(curve, **dict(zip(curve.free, start, strict=True)))
        for value, parameter in zip(start, curve.free, strict=True):
            assert curve.PARAMETERS[parameter].lower <= value <= curve.PARAMETERS[parameter].upper
        highest = np.max(adhesion(begun, np.linspace(0.0, 0.5, 2001)))
        assert 0.5 * top < highest < 1.5 * top
