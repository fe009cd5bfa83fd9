"""The state of a search: the effects accepted so far, and the base curve fitted with them."""

from collections.abc import Sequence
from typing import NamedTuple

from adhesion_jax.discovery.model.fitting import Fitted, Setting, refitted, robustly_fitted
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.types import Candidate
from adhesion_jax.effects import Constant, Effect, ShapeTerm

#: Largest number of forms of a law, all parts of all effects: a search adds none where there are as
#: many. By hand, to limit the time: with 18 that of 20,000 rows of a tyre rig took more than three
#: times as long.
MOST_FORMS = 12

#: What no curve has a constant of, since each passes through the origin.
AT_THE_ORIGIN = ("offset", "shift")


class Accepted(NamedTuple):
    """An effect of the model: what it is called, and what it consists of."""

    name: str
    members: tuple[str, ...]  # names that the data cannot tell from it, its own first
    family: str
    generic: bool  # a plain column, without a physical cause
    covariates: tuple[str, ...]
    parts: tuple[Effect, ...]  # the effect, then what refines its form
    p: float
    gain: float  # of the log likelihood of runs left out, summed over all runs
    by_trees: bool = False  # whether p is that of boosted trees, for whose columns it was found


def as_effect(
    entry: Entry, members: tuple[str, ...], part: Effect, p: float, gain: float
) -> Accepted:
    """The effect that an entry of the library becomes."""
    own = entry.name, members, entry.family, entry.generic, entry.covariates
    return Accepted(*own, (part,), p, gain)


class Selection(NamedTuple):
    """The state of a search; functions return a new one."""

    fitted: Fitted  # the base curve with the effects accepted
    accepted: tuple[Accepted, ...] = ()
    ranking: tuple[Candidate, ...] = ()
    thresholds: tuple[float, ...] = ()  # by round, the z needed for acceptance

    @property
    def base(self) -> str:
        return self.fitted.base

    @property
    def setting(self) -> Setting:
        """The data, and the weights by what the model leaves."""
        return self.fitted.setting

    @property
    def full(self) -> bool:
        """Whether the law has as many forms as a search may give it."""
        return len(self.fitted.effects) >= MOST_FORMS


#: A part of an effect: the number of the effect among those accepted, and that of the part in it.
Place = tuple[int, int]


def parts_of(accepted: Sequence[Accepted]) -> tuple[Effect, ...]:
    """The parts of all effects, effect by effect."""
    return tuple(part for effect in accepted for part in effect.parts)


def slots_of(accepted: Sequence[Accepted]) -> list[Place]:
    """Which part stands in each slot of a model fitted with `parts_of(accepted)`.

    A model applies its effects in the order of their ORDER; equals keep their order.
    """
    places = [
        (number, part)
        for number, effect in enumerate(accepted)
        for part in range(len(effect.parts))
    ]
    return sorted(places, key=lambda place: accepted[place[0]].parts[place[1]].ORDER)


def all_but(accepted: Sequence[Accepted], number: int) -> tuple[Accepted, ...]:
    """The effects without the one of that number."""
    return (*accepted[:number], *accepted[number + 1 :])


def settled(state: Selection, accepted: Sequence[Accepted]) -> Selection:
    """The state with these effects: refitted, with the weights that its own residual asks for.

    Beside forms of an offset or a shift stands a constant.
    """
    accepted = with_constants(accepted)
    fitted = robustly_fitted(refitted(state.fitted, parts_of(accepted)))
    return state._replace(
        fitted=fitted, accepted=with_parts(accepted, slots_of(accepted), fitted.effects)
    )


def with_constants(accepted: Sequence[Accepted]) -> tuple[Accepted, ...]:
    """The effects, the first that acts on an offset with a constant of it, and so of a shift."""
    old = [part for part in parts_of(accepted) if isinstance(part, Constant)]
    effects = [
        effect._replace(
            parts=tuple(part for part in effect.parts if not isinstance(part, Constant))
        )
        for effect in accepted
    ]
    for acts_on in AT_THE_ORIGIN:
        acting = (
            place
            for place, effect in enumerate(effects)
            if any(isinstance(part, ShapeTerm) and part.acts_on == acts_on for part in effect.parts)
        )
        place = next(acting, None)
        if place is not None:
            known = (part for part in old if part.acts_on == acts_on)
            constant = next(known, Constant(0.0, acts_on=acts_on))
            effects[place] = effects[place]._replace(parts=(*effects[place].parts, constant))
    return tuple(effects)


def with_parts(
    accepted: Sequence[Accepted], slots: Sequence[Place], effects: Sequence[Effect]
) -> tuple[Accepted, ...]:
    """The accepted effects with the parts that stand in the slots of a fit.

    `slots` says which part each of the `effects` of the fit is, [slots].
    """
    fitted = dict(zip(slots, effects, strict=True))
    return tuple(
        effect._replace(
            parts=tuple(fitted[place] for place in sorted(fitted) if place[0] == number)
        )
        for number, effect in enumerate(accepted)
    )
