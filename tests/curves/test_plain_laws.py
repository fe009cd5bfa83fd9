"""Curves and laws under the plain transformations of jax."""

import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes

from adhesion_jax.curves import BASES, free_values, with_free_values
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.contact import Relaxation
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.slip_velocity import Speed
from adhesion_jax.effects.surroundings import Humidity

NOW = {"vehicle_speed_mps": 15.0, "normal_load_N": 1.0e5, "relative_humidity_pct": 60.0}
RANGES = {"relative_humidity_pct": (30.0, 90.0), "vehicle_speed_mps": (10.0, 30.0)}
SLIPS = jnp.array([0.004, 0.02, 0.15])
STEP = 1e-6


def law(*effects):
    return CorrectedLaw(BASES["kiencke"], effects, RANGES, Calendar("run_order", 0.0, 59.0))


LAWS = {
    **BASES,
    "no effect": law(),
    "humidity": law(Humidity(k=-0.05, centre=50.0, width=150.0, reference=50.0)),
    "speed and humidity": law(
        Speed(*(0.01 for _ in Speed.FACTS.parameters)),
        Humidity(k=-0.05, centre=50.0, width=150.0, reference=50.0),
    ),
    "relaxation": law(Relaxation(*(0.3 for _ in Relaxation.FACTS.parameters))),
}


def central(function, at):
    return (function(at + STEP) - function(at - STEP)) / (2 * STEP)


@pytest.mark.parametrize("name", lanes(LAWS, always=3, thorough=len(LAWS), long=2))
def test_by_slip(name):
    law = LAWS[name]
    alone = [float(law(slip, NOW)) for slip in SLIPS]
    np.testing.assert_allclose([jax.jit(law)(slip, NOW) for slip in SLIPS], alone, rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(law, (0, None))(SLIPS, NOW), alone, rtol=1e-12)
    slopes = jax.vmap(jax.grad(law), (0, None))(SLIPS, NOW)
    differences = [central(lambda s: law(s, NOW), slip) for slip in SLIPS]
    np.testing.assert_allclose(slopes, differences, rtol=1e-5, atol=1e-8)


@pytest.mark.parametrize("name", lanes(LAWS, always=3, thorough=len(LAWS), long=2))
def test_by_its_numbers_and_by_conditions(name):
    law, slip = LAWS[name], SLIPS[1]
    slopes = jax.grad(lambda law: law(slip, NOW))(law)
    leaves, form = jax.tree.flatten(law)
    for place, slope in enumerate(jax.tree.leaves(slopes)):
        size = max(abs(leaves[place]), 1e-3)

        def moved(share, place=place, size=size):
            others = list(leaves)
            others[place] += share * size
            return jax.tree.unflatten(form, others)(slip, NOW)

        assert slope * size == pytest.approx(float(central(moved, 0.0)), rel=1e-4, abs=1e-8)
    slopes = jax.grad(lambda now: law(slip, now))(NOW)
    for column, slope in slopes.items():

        def at(share, column=column):
            return law(slip, {**NOW, column: (1 + share) * NOW[column]})

        assert slope * NOW[column] == pytest.approx(float(central(at, 0.0)), rel=1e-4, abs=1e-8)


@pytest.mark.parametrize("name", lanes(LAWS, always=3, thorough=len(LAWS)))
def test_what_it_is_made_of_may_be_arrays(name):
    """As it is where parameters were found by a solver; methods are compiled like functions."""
    arrays = jax.tree.map(jnp.asarray, LAWS[name])
    assert jax.jit(arrays)(SLIPS[1], NOW) == pytest.approx(float(LAWS[name](SLIPS[1], NOW)))
    assert hash(arrays) == hash(jax.tree.map(jnp.asarray, LAWS[name]))
    found, plain = jax.jit(arrays.peak)(NOW), LAWS[name].peak(NOW)
    np.testing.assert_allclose(found.adhesion, plain.adhesion, rtol=1e-9)


def test_a_family_of_curves_at_once():
    curve = BASES["burckhardt"]
    family = jnp.stack([free_values(curve), 1.1 * free_values(curve)])
    peaks = jax.vmap(lambda values: with_free_values(curve, values).peak({}))(family)
    alone = [with_free_values(curve, values).peak({}).adhesion for values in family]
    np.testing.assert_allclose(peaks.adhesion, alone, rtol=1e-12)


_NUMBERS = """
import adhesion_jax as aj, jax, jax.numpy as jnp, numpy as np
from adhesion_jax.curves.bent import Bent

assert not jax.config.jax_enable_x64
curve = aj.Kiencke(a0=40.0, p1=31.3, p2=100.0)
aj.save_law("law.json", Bent(curve, np.zeros(10), 0.01, 0.2))
for law in (Bent(curve, np.zeros(10), 0.01, 0.2), aj.load_law("law.json")):
    # Numbers in, double precision out; the peak too.
    exact = 40.0 * 0.02 / (1 + 31.3 * 0.02 + 100.0 * 0.02**2)
    found = law(0.02, {}), law([0.01, 0.02], {})[1], law(np.array([0.02]), {})[0]
    assert max(abs(one - exact) for one in found) < 1e-15, found
    assert all(one.dtype == np.float64 for one in found)
    peak = law.peak({})
    assert abs(peak.slip - 0.1) < 1e-12 and peak.adhesion.dtype == np.float64
    # Arrays of jax have the precision of the program, and are traced as ever.
    assert law(jnp.asarray(0.02), {}).dtype == jnp.float32
    assert jax.jit(law)(0.02, {}).dtype == jnp.float32
    inside = jax.jit(lambda scale: scale * law(0.02, {}))(1.0)
    assert inside.dtype == jnp.float32 and abs(inside - exact) < 1e-6
    assert abs(jax.grad(law)(0.1, {})) < 1e-5
assert not jax.config.jax_enable_x64
"""


@pytest.mark.long
def test_laws_of_numbers_are_in_double_precision_whatever_jax_is_set_to(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", _NUMBERS], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
