"""The contract of an effect: something that an adhesion law may lack."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter

#: The conditions of all measured points, by column, flat: what a grid of starts is laid over.
Columns = Mapping[str, np.ndarray]


class Effect(eqx.Module):
    """One effect on top of any law: law(slip) becomes after(law(before(slip))).

    The numeric fields are its parameters, described by PARAMETERS in their order. Those of
    STRENGTHS are zero where there is no effect; those of REFERENCES are no parameters to be
    found but the median of a column, so that the law below keeps its meaning.
    NEEDS names the columns without which the effect cannot be evaluated. ORDER sorts the effects
    of a law: those that bend the slip are applied first (0), those of the signals last (2). Only
    effects of order 0 may bend the slip.
    PHRASE names the effect within a sentence, with {} for its columns where it is a form over any
    column; FORMULA is its equation for the reader, l the slip and mu the law below.

    Conditions are those of one run in the order of time, arrays [points]; effects that act in
    time need `time_s`. Where `time_s` is absent or a scalar, they are in their steady state.
    """

    PARAMETERS: eqx.AbstractClassVar[Mapping[str, Parameter]]
    STRENGTHS: eqx.AbstractClassVar[tuple[str, ...]]
    REFERENCES: eqx.AbstractClassVar[Mapping[str, str]]
    NEEDS: eqx.AbstractClassVar[tuple[str, ...]]
    ORDER: eqx.AbstractClassVar[int]
    PHRASE: eqx.AbstractClassVar[str]
    FORMULA: eqx.AbstractClassVar[str]

    @abstractmethod
    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        """The slip at which the law below is evaluated."""

    @abstractmethod
    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        """The adhesion with the effect, from that of the law below; `slip` is the measured one."""

    @classmethod
    @abstractmethod
    def starts(cls, columns: Columns) -> Sequence["Effect"]:
        """Effects to try first: of small strength, over a grid of the other parameters."""
