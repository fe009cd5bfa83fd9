"""Laws in tables against the laws themselves: adhesion, its slope, and the peak at every speed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.curves import CURVES, Burckhardt, Law, PolachFalling
from adhesion_jax.curves.bent import FUNCTIONS, Bent
from adhesion_jax.measured.rails import peaked, tabulated

FACTORS, BRAKING = np.random.default_rng(4).normal(0, 0.02, (2, FUNCTIONS))
FALLING = PolachFalling(mu0=0.35, a=0.0, b=0.26, stiffness=210.0, k_s=0.43)
BENT = {
    "burckhardt": Bent(Burckhardt(c1=0.3, c2=40.0, c3=0.5), FACTORS, 0.005, 0.21),
    "in braking": Bent(Burckhardt(c1=0.3, c2=40.0, c3=0.5), FACTORS, 0.02, 0.3, BRAKING),
    "falling": Bent(FALLING, FACTORS, 0.005, 0.21),
}
SPEEDS = (0.06, 0.3, 2.0, 4.9713, 11.7, 36.1, 83.0, 149.9)


class TwoMaxima(Law):
    """The maximum at the larger slip is the higher one below 7 m/s, and the other one above."""

    def __call__(self, slip, conditions):
        far = 0.3 * (conditions["vehicle_speed_mps"] / 7.0) ** -0.1
        near, beyond = (
            jnp.exp(-2 * jnp.log(jnp.maximum(slip, 1e-9) / at) ** 2) for at in (0.02, 0.3)
        )
        return 0.3 * near + far * beyond


@jax.jit
def quick_of(law):
    return peaked(tabulated(law), 1.0)


def column(speed):
    return {"vehicle_speed_mps": jnp.asarray(speed)}


def slopes(law, slip, speed):
    return jax.vmap(jax.grad(lambda one: law(one, column(speed))))(slip)


@pytest.mark.parametrize("name", BENT)
def test_a_departure_in_a_table_is_the_departure(name):
    law = BENT[name]
    half = np.geomspace(1e-6, 2 * law.largest, 4001)
    slip = jnp.asarray(np.concatenate([-half, half]))
    # At slip zero the sign in an odd law has no derivative.
    whole = jnp.append(slip, 0.0)

    @jax.jit
    def adhesions_and_slopes(speed):
        laws = tabulated(law), law
        return [(one(whole, column(speed)), slopes(one, slip, speed)) for one in laws]

    for speed in (0.5, 5.0, 40.0):
        (found, slope), (expected, exact) = adhesions_and_slopes(speed)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
        np.testing.assert_allclose(slope, exact, rtol=0, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("law", [*BENT.values(), CURVES["exponential"], TwoMaxima()])
def test_a_peak_that_is_known_is_that_of_the_law_at_every_speed(law):
    quick = quick_of(law)
    grid = jnp.geomspace(1e-3, 1.0, 20_001)

    @jax.jit
    def peaks(speed):
        now = column(speed)
        return quick.peak(now), law.peak(now, 1.0), law(grid, now).max()

    for speed in SPEEDS:
        found, sought, highest = peaks(speed)
        assert bool(found.found) == bool(sought.found)
        np.testing.assert_allclose(found.slip, sought.slip, rtol=1e-6)
        np.testing.assert_allclose(found.adhesion, sought.adhesion, rtol=0, atol=1e-10)
        assert -1e-10 < float(found.adhesion) - float(highest) < 1e-7


def test_where_two_maxima_change_places_the_higher_one_is_the_peak():
    law = TwoMaxima()
    quick, grid = quick_of(law), jnp.geomspace(1e-3, 1.0, 20_001)
    both = jax.jit(lambda speed: (quick.peak(column(speed)), law(grid, column(speed))))
    for speed in np.linspace(6.9, 7.1, 41):
        found, adhesion = both(speed)
        assert float(found.adhesion) == pytest.approx(float(adhesion.max()), rel=1e-5)
        if abs(speed - 7.0) > 0.01:
            assert float(found.slip) == pytest.approx(float(grid[adhesion.argmax()]), rel=1e-2)


def test_a_speed_beyond_the_table_has_the_peak_of_the_nearest():
    quick = quick_of(BENT["falling"])
    peak = jax.jit(lambda speed: quick.peak(column(speed)))
    for speed, nearest in ((0.0, 0.05), (-2.0, 0.05), (400.0, 150.0)):
        found = peak(speed)
        np.testing.assert_allclose(found.slip, peak(nearest).slip, rtol=1e-12)
        assert float(found.adhesion) == pytest.approx(float(quick(found.slip, column(speed))))


def test_nothing_is_sought_that_is_known():
    law = BENT["falling"]
    quick = quick_of(law)
    sought, known = (
        str(jax.make_jaxpr(lambda of: of.peak(column(5.0)))(of)) for of in (law, quick)
    )
    assert "scan[" in sought
    assert "scan[" not in known
