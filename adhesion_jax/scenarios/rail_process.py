"""What the rail does in the course of a run."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Curve, free_values, with_free_values
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.errors import InputError

C = TypeVar("C", bound=Curve)


class RailProcess(eqx.Module):
    """The law of the rail: one for all the run, or one for each block.

    The parameters of a curve are scalars, or one for each sample of a run. `names` are those of the
    rail at the end of each block.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    law: Curve | CorrectedLaw | tuple[Curve, ...]
    #: What the law needs, is the same in all runs, and nobody measures.
    conditions: Mapping[str, float] = eqx.field(default_factory=dict)
    #: Whether every sample has another curve.
    drifts: bool = eqx.field(default=False, static=True)

    @property
    def curve(self) -> Curve:
        """The law, without effects; parameters go with the signals of a run (`Course.shape`)."""
        if isinstance(self.law, tuple):
            return of_many(self.law, (-1, 1))
        curve = self.law.curve if isinstance(self.law, CorrectedLaw) else self.law
        assert isinstance(curve, Curve)
        return curve

    def adhesion(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        """The true adhesion at each sample of a run."""
        conditions = {**conditions, **self.conditions}
        if isinstance(self.law, tuple):
            of_block = [
                {name: jnp.broadcast_to(x, slip.shape)[b] for name, x in conditions.items()}
                for b in range(len(slip))
            ]
            parts = zip(self.law, slip, of_block, strict=True)
            return jnp.stack([curve(own, measured) for curve, own, measured in parts])
        if isinstance(self.law, CorrectedLaw) and slip.ndim > 1:  # it takes one whole run in time
            return jax.vmap(self.law)(slip, conditions)
        return self.law(slip, conditions)

    def sensitivity(
        self, curve: Curve, slip: Float[Array, " points"], conditions: Conditions
    ) -> Float[Array, "free points"]:
        """The derivatives of the adhesion by the free parameters of the curve, were it this one.

        Parameters that differ from point to point change by the same at all of them.
        """
        values = free_values(curve)
        _, push = jax.linearize(lambda x: self._were(curve, x, slip, conditions), values)
        units = jnp.eye(len(values)).reshape(values.shape[0], -1, *(1,) * (values.ndim - 1))
        return jax.vmap(push)(jnp.broadcast_to(units, (len(values), *values.shape)))

    def slope(
        self, curve: Curve, slip: Float[Array, " points"], conditions: Conditions
    ) -> Float[Array, " points"]:
        """The derivative of the adhesion by the slip."""
        values = free_values(curve)
        _, slope = jax.jvp(
            lambda slip: self._were(curve, values, slip, conditions),
            (slip,),
            (jnp.ones_like(slip),),
        )
        return slope

    def _were(
        self,
        curve: Curve,
        values: Float[Array, "*free_and_points"],
        slip: Float[Array, " points"],
        conditions: Conditions,
    ) -> Float[Array, " points"]:
        """The adhesion, were the curve this one with these free parameters."""
        changed = with_free_values(curve, values)
        conditions = {**conditions, **self.conditions}
        if isinstance(self.law, CorrectedLaw):
            return dataclasses.replace(self.law, curve=changed)(slip, conditions)
        return changed(slip, conditions)


def steady(
    curves: Mapping[str, Curve], rail: str, blocks: int = 1, option: str = "rail"
) -> RailProcess:
    """One rail, of this name; InputError if there is none."""
    if rail not in curves:
        raise InputError(f"--{option} {rail} is unknown; the rails are {', '.join(curves)}.")
    return RailProcess((rail,) * blocks, curves[rail])


def of_many(curves: Sequence[C], shape: tuple[int, ...]) -> C:
    """Curves of one kind as one, whose parameters have this shape."""
    parameters = np.array([jax.tree.leaves(curve) for curve in curves], dtype=float).T
    together: C = jax.tree.unflatten(
        jax.tree.structure(curves[0]), [jnp.asarray(values.reshape(shape)) for values in parameters]
    )
    return together
