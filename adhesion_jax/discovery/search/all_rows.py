"""What was found in blocks of rows, fitted to all rows and tested on them."""

import numpy as np

from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.model.fitting import Fitted, p_of, with_noise_left
from adhesion_jax.discovery.model.rows import Ranges, fitted_to_rows, seen_by_rows
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.state import Selection, all_but, refreshed, slots_of, without


def on_rows(
    state: Selection, runs: RunSet | None, ranges: Ranges, white: bool = False
) -> tuple[Selection, Fitted]:
    """The state fitted to all rows, and its fit there; if there are no other rows (None): as it is.

    If the slip is noisy, the parameters of the search stay: AR(1) noise, under which the rows are
    fitted, does not know how the errors of the slip are correlated.
    """
    if runs is None:
        return state, state.fitted
    noisy = state.setting.problem.slip_noise is not None
    found = (
        seen_by_rows(state.fitted, runs, ranges)
        if noisy
        else fitted_to_rows(state.fitted, runs, ranges, white)
    )
    accepted = refreshed(state.accepted, found.blocks.effects)
    fits = {**state.fits, state.base: found.blocks}
    return state._replace(fits=fits, accepted=accepted), found.rows


def sure_on_rows(
    state: Selection, runs: RunSet | None, ranges: Ranges
) -> tuple[Selection, Fitted, list[str]]:
    """`on_rows` of the state without the effects that are not sure there, and why they are not."""
    words: list[str] = []
    while True:
        found, rows = on_rows(state, runs, ranges)
        number, p = least_sure(found, rows)
        if p <= rules.SIGNIFICANT:
            return found, rows, words
        words.append(
            f"{found.accepted[number].name} was found, but its strength differs from run to run by "
            f"so much that it may be zero (p = {p:.2g}); it is not counted as an effect."
        )
        state = without(state, all_but(state.accepted, number))


def with_noise_of_rows(
    plain: Selection, of_rows: Fitted, runs: RunSet | None, ranges: Ranges
) -> tuple[Selection, Fitted]:
    """The curve alone, fitted by least squares, and its fit `of_rows`, with the noise it leaves."""
    left = with_noise_left(plain.fitted)
    if runs is None:
        return plain._replace(fits={plain.base: left}), left
    bare = seen_by_rows(left, runs, ranges)
    return plain._replace(fits={plain.base: bare.blocks}), of_rows._replace(
        setting=bare.rows.setting
    )


def least_sure(state: Selection, fitted: Fitted) -> tuple[int, float]:
    """The accepted effect of largest p (`p_of`) in a fit of the state, and that p; 0 for none."""
    slots = slots_of(state.accepted)
    p = [
        p_of(fitted, [slot for slot, place in enumerate(slots) if place[0] == number])
        for number in range(len(state.accepted))
    ]
    return (int(np.argmax(p)), max(p)) if p else (0, 0.0)
