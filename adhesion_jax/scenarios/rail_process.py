"""What the rail does in the course of a run."""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Curve, free_values, with_free_values
from adhesion_jax.errors import InputError
from adhesion_jax.options import Fall, Period, Recovery, Shift, WaveHeight

C = TypeVar("C", bound=Curve)


class RailProcess(eqx.Module):
    """The curve of the rail along a run.

    Its parameters are scalars or go with the signals of a run (`Course.shape`): one for each block
    or for each sample. `names` are those of the rail at the end of each block.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    curve: Curve
    #: What the curve needs, is the same in all runs, and nobody measures.
    conditions: Mapping[str, float] = eqx.field(default_factory=dict)
    #: Whether every sample has another curve.
    drifts: bool = eqx.field(default=False, static=True)

    def adhesion(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        """The true adhesion at each sample of a run."""
        return self.curve(slip, {**conditions, **self.conditions})

    def derivatives(
        self, curve: Curve, slip: Float[Array, " points"], conditions: Conditions
    ) -> tuple[Float[Array, "free points"], Float[Array, " points"]]:
        """Those of the adhesion by the free parameters and by the slip, were the curve this one."""
        conditions = {**conditions, **self.conditions}

        def adhesion(
            values: Float[Array, " free"], slip: Float[Array, " points"]
        ) -> Float[Array, " points"]:
            return with_free_values(curve, values)(slip, conditions)

        values = free_values(curve)
        _, push = jax.linearize(lambda values: adhesion(values, slip), values)
        by_slip = jax.jvp(lambda slip: adhesion(values, slip), (slip,), (jnp.ones_like(slip),))[1]
        return jax.vmap(push)(jnp.eye(len(curve.free))), by_slip


#: Samples of a wave, where nothing else is said.
_PERIOD = 500.0


class Change(eqx.Module):
    """What becomes of a rail in a run, at a constant initial slope or of the curve as a whole.

    It loses a share `fall` of its adhesion evenly from the first to the last sample, and the slip
    of the peak grows by the share `shift` meanwhile. With `recovery` it loses that share at once
    in the middle of the run and recovers exponentially with this time constant in samples. A sine
    of amplitude `wave` and of `period` samples goes on top.
    """

    fall: Fall = eqx.field(default=0.0, static=True)
    shift: Shift = eqx.field(default=0.0, static=True)
    recovery: Recovery = eqx.field(default=0.0, static=True)
    wave: WaveHeight = eqx.field(default=0.0, static=True)
    period: Period = eqx.field(default=_PERIOD, static=True)

    def course(self, points: int) -> tuple[np.ndarray, np.ndarray]:
        """The height of the peak and its slip over those of the rail before, at each sample.

        InputError where no adhesion is left, or an option is of what there is not.
        """
        if self.recovery and not self.fall:
            raise InputError(
                f"--recovery {self.recovery:g} is the time in which a loss of adhesion goes back, "
                "and nothing is lost; give --fall too."
            )
        if self.period != _PERIOD and not self.wave:
            raise InputError(
                f"--period {self.period:g} is that of the wave, and there is none; give --wave too."
            )
        sample, last = np.arange(points), points - 1
        lost = self.fall * sample / last
        if self.recovery:
            since = sample - points // 2
            left = np.exp(-np.maximum(since, 0) / self.recovery)
            lost = np.where(since < 0, 0.0, self.fall * left)
        wave = self.wave * np.sin(2 * np.pi * sample / self.period)
        level = 1 - lost + wave
        if level.min() <= 0:
            raise InputError(
                f"--fall {self.fall:g} and --wave {self.wave:g} leave {level.min():.2g} of the "
                "adhesion of the rail, which must stay above 0; make one of them smaller."
            )
        return level, 1 + self.shift * sample / last


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
