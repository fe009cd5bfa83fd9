"""A curve that falls with the speed by itself, in the place of one beside which an effect does."""

from collections.abc import Callable, Sequence

import numpy as np

from adhesion_jax.discovery.model.bases import best_alone, under
from adhesion_jax.discovery.model.fitting import Setting
from adhesion_jax.discovery.model.prediction import gain
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.selection import search
from adhesion_jax.discovery.search.state import Selection


def plainer(
    plain: Selection,
    final: Selection,
    falling: Sequence[str],
    spread: np.ndarray,
    entries: Sequence[Entry],
    seed: int,
    progress: Callable[[str, float], None],
) -> tuple[Selection, Selection]:
    """The states without and with effects: those given, or those of the best of the curves named.

    `falling` are curves that fall with the slip velocity, such as Polach's with falling friction.
    An effect of the slip velocity beside another curve and such a curve alone describe nearly the
    same. The cause is named only if its law predicts runs left out surely better, or as well with a
    smaller departure: otherwise the fall is a matter of the curve.
    """
    if not falling:
        return plain, final
    steep = Selection(best_alone(plain.setting.problem, spread, falling))
    gained = gain(plain.fitted, under(_like(plain, steep), steep.fitted))
    if gained.deviate <= rules.SURE_ERRORS_OF_COLUMN:
        return plain, final
    other = search(steep, entries, seed, progress)
    ahead = gain(under(_like(final, other), other.fitted), final.fitted)
    bends = [state.setting.problem.bend for state in (other, final)]
    if ahead.total > ahead.error or (abs(ahead.total) <= ahead.error and bends[0] > bends[1]):
        return plain, final
    return steep, other


def _like(state: Selection, bent: Selection) -> Setting:
    """The weights of a state, with the departure of another."""
    return state.setting._replace(problem=bent.setting.problem)
