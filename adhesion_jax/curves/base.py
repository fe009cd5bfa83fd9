"""The contract of an adhesion law: adhesion as a function of slip, and its peak."""

import dataclasses
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from adhesion_jax.curves.peak import Peak, find_peak
from adhesion_jax.curves.precision import precise_of_numbers
from adhesion_jax.programs import kept

Scalar = float | Float[Array, ""]
Conditions = Mapping[str, Float[Array, "..."] | float]

#: Those of a law that depends on the slip alone.
NO_CONDITIONS: Conditions = MappingProxyType({})

#: Arrays of one shape in a function: those of a steady state, or of the points of a run.
Signal = Float[Array, "*shape"]

#: Largest slip at which a peak is searched: as a ratio, where the wheel turns at twice its rolling
#: speed, and as a velocity in m/s.
SLIP_LIMIT = 1.0
SLIP_VELOCITY_LIMIT = 10.0


class Parameter(NamedTuple):
    """One parameter of a curve: unit, physical bounds, meaning and source."""

    unit: str
    lower: float
    upper: float
    meaning: str
    source: str


def content_hash(module: eqx.Module) -> int:
    """A hash by the numbers of a module, so that it and its methods can be given to `jax.jit`.

    That of equinox takes Python's numbers and no arrays.
    """
    numbers = (np.asarray(leaf) for leaf in jax.tree.leaves(module))
    return hash((type(module), *(number.tobytes() for number in numbers)))


class Law(eqx.Module):
    """Adhesion as a function of slip and of the conditions it is taken under."""

    __hash__ = content_hash

    @abstractmethod
    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        """Adhesion at `slip`, odd in slip.

        `conditions` holds columns by name (vehicle_speed_mps, normal_load_N ...), each a scalar
        or of the shape of `slip`; a law uses those it needs and ignores the others.
        """

    @precise_of_numbers
    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        """The largest adhesion for 0 <= slip <= slip_limit, under scalar `conditions`.

        It is found numerically where a law has no closed form of its own for it.
        """
        return find_peak(lambda slip: self(slip, conditions), slip_limit)


class Curve(Law):
    """A law whose fields are its parameters.

    Attributes:
        PARAMETERS: unit, bounds, meaning and source of every field.
        NEEDS: the conditions without which the curve cannot be evaluated.
        AUTOMATIC: whether a discovery considers the curve in its own choice.
        free: the names of the parameters that are identified; the others are known.
    """

    PARAMETERS: eqx.AbstractClassVar[Mapping[str, Parameter]]
    NEEDS: eqx.AbstractClassVar[tuple[str, ...]]
    AUTOMATIC: eqx.AbstractClassVar[bool]
    free: eqx.AbstractVar[tuple[str, ...]]

    @classmethod
    @abstractmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        """Free parameters to start a fit from, for data whose largest adhesion is about `top`."""


C = TypeVar("C", bound=Curve)


@kept()
def adhesion_of(law: Law, slip: Float[ArrayLike, "*shape"], conditions: Conditions) -> Signal:
    """`law(slip, conditions)` as one program: called as it is, a law compiles each operation."""
    return law(jnp.asarray(slip), conditions)


def free_values(curve: Curve) -> Float[Array, " free"]:
    """The free parameters of a curve in the order of `free`."""
    return jnp.stack([jnp.asarray(getattr(curve, name), dtype=float) for name in curve.free])


def with_free_values(curve: C, values: Float[Array, " free"] | Float[np.ndarray, " free"]) -> C:
    """The same curve with its free parameters replaced, in the order of `free`."""
    return dataclasses.replace(curve, **dict(zip(curve.free, values, strict=True)))


def physical_box(curve: Curve) -> tuple[Float[Array, " free"], Float[Array, " free"]]:
    """Lower and upper physical bounds of the free parameters."""
    described = [curve.PARAMETERS[name] for name in curve.free]
    return jnp.array([p.lower for p in described]), jnp.array([p.upper for p in described])
