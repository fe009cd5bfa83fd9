"""The contract of a physical cause: an effect, and what the package needs to know about it."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import equinox as eqx

from adhesion_jax.curves import Conditions
from adhesion_jax.effects.base import Effect, Form, Signal, Values


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
    says is true where the strength is above 0 alone. `screened`: it is looked for among the
    candidates of the search, rather than by a test of its own. `driven_by` is the column whose step
    shows a memory: the slip ratio, or one that is set from zero to one.
    """

    needs: tuple[str, ...] = field()  # none must be said, too
    starts: Sequence[Mapping[str, float]] = field()  # none where they depend on the columns
    sentence: str
    family: str
    rests_on: tuple[str, ...] = ()
    same_as: tuple[str, ...] = ()
    of_slip_alone: bool = False
    one_sided: bool = False
    screened: bool = True
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
