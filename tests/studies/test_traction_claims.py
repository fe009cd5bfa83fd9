"""The claims on traction control: what they are computed with."""

import pytest

from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.systems import SYSTEMS
from experiments.claims.hxd1f import settling
from experiments.claims.traction import plant_of


def test_a_double_pole_settles_as_its_step_response():
    plant = plant_of(SYSTEMS["hxd1f"])
    # (1 + x) exp(-x) = .02 at x = 5.83; means over 2 ms.
    assert settling(FullDimension(-100.0), plant) == pytest.approx(0.0583, abs=0.0025)
