"""Whether slip and adhesion bear each other's names, by which of them is the function of the other.

How smoothly one signal follows another is also what a delay between the two is told by.
"""

import numpy as np
from jaxtyping import Float

from adhesion_jax.wording import percent

#: Bins of the abscissa, and the fewest points of one.
_BINS, _FEWEST = 12, 5

#: A curve saturates whose medians at half of the largest abscissa are at least this share of their
#: largest. One of two is the function of the other if neighbours by it differ this factor less.
_SATURATED, _SMOOTHER = 0.6, 2.0

#: Most rows that are judged.
_MOST_ROWS = 200_000


def exchanged(slip: Float[np.ndarray, " rows"], adhesion: Float[np.ndarray, " rows"]) -> str:
    """A sentence where slip is a function of adhesion that saturates, and not the other way.

    Adhesion over slip rises within small slips and has one value at each. Where the names are
    exchanged, what is called slip does so over what is called adhesion.
    """
    some = np.linspace(0, slip.size - 1, min(slip.size, _MOST_ROWS)).astype(int)
    size, pull = np.abs(slip[some]), np.where(slip[some] < 0, -1.0, 1.0) * adhesion[some]
    half = at_half(pull, size)
    if half < _SATURATED:
        return ""
    of_adhesion, of_slip = roughness(size, pull), roughness(pull, size)
    if of_adhesion < _SMOOTHER * of_slip:
        return ""
    return (
        "Slip and adhesion look exchanged: what is called slip is a function of what is called "
        f"adhesion and reaches {percent(half)} of its largest value at half of the largest "
        f"adhesion, as adhesion does over slip, while at the same slip adhesion differs "
        f"{of_adhesion / max(of_slip, 1e-300):.2g} times more; exchange them, as by --column "
        '"slip_ratio=adhesion" --column "adhesion=slip_ratio".'
    )


def bins_of(slip: Float[np.ndarray, " rows"]) -> list[np.ndarray]:
    """Rows of bins of equal width in the root of slip; one of too few rows joins the next."""
    order = np.argsort(slip, kind="stable")
    place = (_BINS * np.sqrt(slip[order] / max(float(slip.max()), 1e-300))).astype(int)
    groups, begin = [], 0
    for end in np.append(np.flatnonzero(np.diff(place)) + 1, slip.size).tolist():
        if end - begin >= _FEWEST:
            groups.append(order[begin:end])
            begin = end
    return groups


def at_half(over: Float[np.ndarray, " rows"], values: Float[np.ndarray, " rows"]) -> float:
    """The least median of values from half of the largest abscissa on, over that of a bin; or 0.

    0 too where they do not rise from below a half of it, so that there is no curve.
    """
    within = over >= 0
    over, values = over[within], values[within]
    groups = bins_of(over) if over.size else []
    if len(groups) < 4:
        return 0.0
    medians = np.array([np.median(values[group]) for group in groups])
    behind = [np.median(over[group]) >= 0.5 * over.max() for group in groups]
    top = float(medians.max())
    if top <= 0 or medians[0] > 0.5 * top or not any(behind):
        return 0.0
    return float(medians[behind].min()) / top


def roughness(over: Float[np.ndarray, " rows"], values: Float[np.ndarray, " rows"]) -> float:
    """The mean difference of values that are neighbours by the abscissa, over their range."""
    low, high = np.quantile(values, [0.01, 0.99])
    steps = np.abs(np.diff(np.clip(values, low, high)[np.argsort(over, kind="stable")]))
    return float(np.mean(steps)) / max(float(high - low), 1e-300)
