"""The contract of an effect, and of a physical cause: what an adhesion law may lack."""

from abc import abstractmethod
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions as Conditions
from adhesion_jax.curves import Parameter
from adhesion_jax.curves import Scalar as Scalar
from adhesion_jax.curves import Signal as Signal

#: A signal in time order, and one sample.
Points = Float[Array, " points"]
Value = Float[Array, ""]

#: What combines with a signal: of its shape, or one number for all.
Values = Float[Array, "..."]

#: The conditions of all measured points, by column, flat: what a grid of starts is laid over.
Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Form:
    """The formula of an effect and what must be known of it to fit and to tell it.

    `described` says unit, lower and upper bound and meaning of the numeric fields, in their order.
    Those of `strengths` are zero where there is no effect; those of `references` are no parameters
    to be found but the median of a column, so that the law below keeps its meaning. `starts` are
    what is tried first: small strengths, over a grid of the other parameters.
    `needs` names the columns without which the effect cannot be evaluated.
    `phrase` names the effect within a sentence, with {} for its columns where it is a form over any
    column; `formula` is its equation for the reader, l the slip and mu the law below.
    """

    source: str
    described: Mapping[str, tuple[str, float, float, str]]
    strengths: tuple[str, ...]
    starts: Sequence[Mapping[str, float]] = ()
    references: Mapping[str, str] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    formula: str
    phrase: str

    @cached_property
    def parameters(self) -> Mapping[str, Parameter]:
        return {name: Parameter(*one, self.source) for name, one in self.described.items()}


class Effect(eqx.Module):
    """One effect on top of any law: law(slip) becomes after(law(before(slip))).

    ORDER sorts the effects of a law: those that bend the slip are applied first (0), then factors
    on the adhesion (1), what depends on the adhesion that there is (2), and errors of the signals
    (3). Only effects of order 0 may bend the slip.

    Conditions are those of one run in the order of time, arrays [points]; effects that act in
    time need `time_s`. Where `time_s` is absent or a scalar, they are in their steady state.
    """

    FACTS: eqx.AbstractClassVar[Form]
    ORDER: ClassVar[int] = 1

    @property
    def held(self) -> Container[str]:
        """The parameters that are not fitted."""
        return self.FACTS.references

    def before(self, slip: Signal, conditions: Conditions) -> Signal:
        """The slip at which the law below is evaluated."""
        return slip

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        """The adhesion with the effect, from that of the law below; `slip` is the measured one."""
        return adhesion

    @classmethod
    def medians(cls, columns: Columns) -> dict[str, float]:
        """The references of the effect in these columns."""
        return {
            name: float(np.median(columns[column])) for name, column in cls.FACTS.references.items()
        }

    @classmethod
    def starts(cls, columns: Columns) -> Sequence["Effect"]:
        """Effects to try first: those that FACTS has, unless they depend on the columns."""
        if not cls.FACTS.starts:
            raise TypeError(f"{cls.__name__} declares no starts; give some in its FACTS.")
        return [cls(**{**cls.medians(columns), **start}) for start in cls.FACTS.starts]


@dataclass(frozen=True, kw_only=True)
class Facts(Form):
    """Everything that other modules ask about a physical cause.

    `sentence` tells what the cause does. `family` is shared by causes whose formulas resemble each
    other: a second one of a family that adds little is a matter of form. `rests_on` names the
    columns that a claim of it rests on, slip_ratio among them where it is a function of the slip;
    by default those that it needs. `same_as` holds the names that say the same: a plain column, a
    wave along a column, or a cause that no data can tell from it; one that ends in a colon stands
    for all that begin with it. `of_slip_alone`: it is a function of nothing else, an error of a
    signal that hardly any data tell from another shape of the curve. `one_sided`: what the sentence
    says is true where the strength is above 0 alone; `rising`: where each of its strengths is above
    those before it, the first above 0. `driven_by` is the column whose step shows a memory: the
    slip ratio, or one that is set from zero to one.
    """

    needs: tuple[str, ...] = field()  # none must be said, too
    starts: Sequence[Mapping[str, float]] = field()  # none where they depend on the columns
    sentence: str
    family: str
    rests_on: tuple[str, ...] = ()
    same_as: tuple[str, ...] = ()
    of_slip_alone: bool = False
    one_sided: bool = False
    rising: bool = False
    driven_by: str = "slip_ratio"

    def __post_init__(self) -> None:
        object.__setattr__(self, "rests_on", self.rests_on or self.needs)


class Cause(Effect):
    """A physical cause; FACTS declares everything that other modules ask about it."""

    FACTS: eqx.AbstractClassVar[Facts]


class Multiplier(Cause):
    """A cause that only scales adhesion: mu factor."""

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        return adhesion * self.factor(slip, conditions)

    @abstractmethod
    def factor(self, slip: Values, conditions: Conditions) -> Values:
        """The factor on adhesion."""


class SlipTransform(Cause):
    """A cause that only bends the slip: mu(before(slip))."""

    ORDER: ClassVar[int] = 0

    @abstractmethod
    def before(self, slip: Signal, conditions: Conditions) -> Signal:
        """The slip at which the law below is evaluated."""


class AdhesionTransform(Cause):
    """A cause that leaves the slip and changes adhesion by more than a factor: after(mu)."""

    @abstractmethod
    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        """The adhesion with the effect, from that of the law below; `slip` is the measured one."""
