"""What was found in blocks of rows, fitted to all rows and tested on them."""

import numpy as np

from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.model.fitting import Fitted, p_of, with_noise_left
from adhesion_jax.discovery.model.rows import Ranges, fitted_to_rows, seen_by_rows
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.state import Selection, all_but, refreshed, slots_of, without


def on_rows(
    state: Selection, runs: RunSet, ranges: Ranges, white: bool = False
) -> tuple[Selection, Fitted]:
    """The state fitted to all rows, and its fit there.

    If the slip is noisy, the parameters of the search stay: AR(1) noise, under which the rows are
    fitted, does not know how the errors of the slip are correlated.
    """
    noisy = state.setting.problem.slip_noise is not None
    found = (
        seen_by_rows(state.fitted, runs, ranges)
        if noisy
        else fitted_to_rows(state.fitted, runs, ranges, white)
    )
    accepted = refreshed(state.accepted, found.blocks.effects)
    fits = {**state.fits, state.base: found.blocks}
    return state._replace(fits=fits, accepted=accepted), found.rows


def tested_on_rows(
    state: Selection, plain: Selection, plain_rows: Fitted, runs: RunSet, ranges: Ranges
) -> tuple[Selection, Fitted, list[str]]:
    """The state fitted to all rows without the effects that are not sure there, and why.

    `plain` is the curve without effects, and `plain_rows` its fit to all rows: if no effect is
    left, it is the law after as well.
    """
    words: list[str] = []
    while state.accepted:
        found, rows = on_rows(state, runs, ranges)
        number, p = least_sure(found, rows)
        if p <= rules.SIGNIFICANT:
            return found, rows, words
        words.append(
            f"{found.accepted[number].name} was found in blocks of rows, but in all rows its "
            f"strength differs from run to run by so much that it may be zero (p = {p:.2g}); it is "
            "not counted as an effect."
        )
        state = without(state, all_but(state.accepted, number))
    if state.setting.problem.slip_noise is not None:
        return (*on_rows(state, runs, ranges), words)
    # The noise alone is estimated better than by least squares.
    bare = seen_by_rows(with_noise_left(plain.fitted), runs, ranges)
    left = state._replace(fits={plain.base: bare.blocks}, base=plain.base)
    return left, plain_rows._replace(setting=bare.rows.setting), words


def least_sure(state: Selection, fitted: Fitted) -> tuple[int, float]:
    """The accepted effect of largest p (`p_of`) in a fit of the state, and that p."""
    slots = slots_of(state.accepted)
    p = [
        p_of(fitted, [slot for slot, place in enumerate(slots) if place[0] == number])
        for number in range(len(state.accepted))
    ]
    return int(np.argmax(p)), max(p)
