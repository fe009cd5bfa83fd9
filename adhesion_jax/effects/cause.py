"""The contract of a physical cause: an effect, and what the package needs to know about it."""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions
from adhesion_jax.effects.base import Effect
from adhesion_jax.effects.planting import Plantable


class Cause(Effect, Plantable):
    """A physical cause; its class declares everything that other modules ask about it.

    SENTENCE tells what the cause does. RESTS_ON names the columns that a claim of it rests on,
    slip_ratio among them where it is a function of the slip. OF_SLIP_ALONE: it is a function of
    nothing else, an error of a signal that hardly any data tell from another shape of the curve.
    ONE_SIDED: what SENTENCE says is true where the strength is above 0 alone. SCREENED: it is
    looked for among the candidates of the search, rather than by a test of its own.
    """

    SENTENCE: eqx.AbstractClassVar[str]
    RESTS_ON: eqx.AbstractClassVar[tuple[str, ...]]
    OF_SLIP_ALONE: ClassVar[bool] = False
    ONE_SIDED: ClassVar[bool] = False
    SCREENED: ClassVar[bool] = True


class Scaling(Cause):
    """A cause that only scales adhesion: mu factor."""

    ORDER: ClassVar[int] = 1

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion * self.factor(slip, conditions)

    @abstractmethod
    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        """The factor on adhesion."""


class Bending(Cause):
    """A cause that only bends the slip: mu(before(slip))."""

    ORDER: ClassVar[int] = 0

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion


class Changing(Cause):
    """A cause that leaves the slip and changes adhesion by more than a factor: after(mu)."""

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip


class Remembering(Cause):
    """A cause with a memory, which a plant advances sample by sample.

    `init` is told the first sample of a run, `step` every sample from the first on; conditions
    are scalars with `time_s`. Over a run it gives what `after` gives; where `after` looks a sample
    ahead, for a rate, to the first order in the time between two samples. DRIVEN_BY is the column
    whose step shows it: the slip ratio, or one that is set from zero to one.
    """

    DRIVEN_BY: eqx.AbstractClassVar[str]

    @abstractmethod
    def init(
        self, adhesion: Float[Array, ""], slip: Float[Array, ""], conditions: Conditions
    ) -> Any:
        """The memory at the start of a run."""

    @abstractmethod
    def step(
        self,
        memory: Any,
        adhesion: Float[Array, ""],
        slip: Float[Array, ""],
        conditions: Conditions,
    ) -> tuple[Any, Float[Array, ""]]:
        """The memory after one more sample, and the adhesion of that sample."""


def now(conditions: Conditions) -> Float[Array, ""]:
    """Time of a sample, s."""
    return jnp.asarray(conditions["time_s"])
