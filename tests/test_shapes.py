"""What declares the shape of an array is checked while tests run, and nothing else is slowed."""

from dataclasses import dataclass

import jax.numpy as jnp
import pytest
from jaxtyping import Array, Float, TypeCheckError
from shapes import checked

from adhesion_jax.effects import EFFECTS
from adhesion_jax.optim import levenberg_marquardt


def test_arguments_and_results_have_the_shapes_that_are_declared():
    @checked
    def doubled(a: Float[Array, " n"], b: float | Float[Array, " n"]) -> Float[Array, " n"]:
        return a[:1] + b

    assert doubled(jnp.ones(1), 1.0) == 2.0
    with pytest.raises(TypeCheckError, match="parameters"):
        doubled(jnp.ones((2, 2)), 1.0)
    with pytest.raises(TypeCheckError, match="parameters"):
        doubled(jnp.ones(2), jnp.ones(3))
    with pytest.raises(TypeCheckError, match="return value"):
        doubled(jnp.ones(2), 1.0)


def test_a_record_has_the_shapes_that_are_declared():
    @checked
    @dataclass
    class Pair:
        a: Float[Array, " n"]
        b: Float[Array, " n"]

    assert Pair(jnp.ones(2), jnp.zeros(2)).b.shape == (2,)
    with pytest.raises(TypeCheckError):
        Pair(jnp.ones(2), jnp.ones(3))


def test_what_declares_no_shape_is_left_alone():
    def plain(a: int, b: list[float]) -> str:
        return f"{a}{b}"

    assert checked(plain) is plain


def test_functions_and_methods_of_the_package_are_checked():
    with pytest.raises(TypeCheckError, match="begin"):
        levenberg_marquardt.begin(jnp.ones((2, 2)))
    with pytest.raises(TypeCheckError, match="factor"):
        EFFECTS["load_peak"](p=0.1, reference=1.0).factor(jnp.ones(2, int), {})
