"""Vectors and symmetric matrices of two unknowns, each element an array of its own.

Over a batch of runs every element is then one array: a recursion on arrays [2] and [2, 2] takes
up to 2.4 times as long.
"""

from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

Element = Float[Array, "*points"]
E = TypeVar("E", bound="_Elements")


class _Elements(eqx.Module):
    def __add__(self: E, other: E) -> E:
        total: E = jax.tree.map(jnp.add, self, other)
        return total

    def __sub__(self: E, other: E) -> E:
        return self + -1.0 * other

    def __rmul__(self: E, factor: float | Element) -> E:
        multiple: E = jax.tree.map(lambda element: factor * element, self)
        return multiple

    def sum(self: E) -> E:
        """Over the points."""
        total: E = jax.tree.map(jnp.sum, self)
        return total


class Vector(_Elements):
    """(a, b)."""

    a: Element
    b: Element

    def dot(self, other: "Vector") -> Element:
        return self.a * other.a + self.b * other.b

    def array(self) -> Float[Array, "2"]:
        return jnp.stack([self.a, self.b])


class Symmetric(_Elements):
    """[[a, b], [b, c]]."""

    a: Element
    b: Element
    c: Element

    def times(self, vector: Vector) -> Vector:
        return Vector(self.a * vector.a + self.b * vector.b, self.b * vector.a + self.c * vector.b)

    def determinant(self) -> Element:
        return self.a * self.c - self.b**2

    def inverse(self) -> "Symmetric":
        """NaN where the determinant is not positive."""
        size = self.determinant()
        return 1 / jnp.where(size > 0, size, jnp.nan) * Symmetric(self.c, -self.b, self.a)

    def full(self) -> "Square":
        return Square(self.a, self.b, self.b, self.c)

    def array(self) -> Float[Array, "2 2"]:
        return jnp.array([[self.a, self.b], [self.b, self.c]])


class Square(_Elements):
    """[[a, b], [c, d]]."""

    a: Element
    b: Element
    c: Element
    d: Element

    def transposed(self) -> "Square":
        return Square(self.a, self.c, self.b, self.d)

    def times(self, vector: Vector) -> Vector:
        return Vector(self.a * vector.a + self.b * vector.b, self.c * vector.a + self.d * vector.b)

    def __matmul__(self, other: "Square") -> "Square":
        return Square(
            self.a * other.a + self.b * other.c,
            self.a * other.b + self.b * other.d,
            self.c * other.a + self.d * other.c,
            self.c * other.b + self.d * other.d,
        )

    def symmetric(self) -> Symmetric:
        """Of one that is symmetric but for rounding."""
        return Symmetric(self.a, self.b, self.d)


def square(vector: Vector) -> Symmetric:
    """V v'."""
    return Symmetric(vector.a**2, vector.a * vector.b, vector.b**2)


def outer(left: Vector, right: Vector) -> Square:
    """L r'."""
    return Square(left.a * right.a, left.a * right.b, left.b * right.a, left.b * right.b)


def no_vector() -> Vector:
    """(0, 0)."""
    return Vector(*2 * [jnp.zeros(())])


def no_matrix() -> Symmetric:
    """[[0, 0], [0, 0]]."""
    return Symmetric(*3 * [jnp.zeros(())])
