"""The contract of an effect: something that an adhesion law may lack."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Signal

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

    ORDER sorts the effects of a law: those that bend the slip are applied first (0), those of the
    signals last (2). Only effects of order 0 may bend the slip.

    Conditions are those of one run in the order of time, arrays [points]; effects that act in
    time need `time_s`. Where `time_s` is absent or a scalar, they are in their steady state.
    """

    FACTS: eqx.AbstractClassVar[Form]
    ORDER: ClassVar[int] = 1

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
