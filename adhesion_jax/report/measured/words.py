"""The verdict on a measured record in words."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.data import Measured
from adhesion_jax.identifiers.base import Status
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.noise import SlipNoise
from adhesion_jax.inference.sandwich import COSINES
from adhesion_jax.inference.weighing import EXACT
from adhesion_jax.measured.answer import Answer
from adhesion_jax.measured.comparison import Comparison
from adhesion_jax.measured.groups import Group
from adhesion_jax.measured.residual import Residual
from adhesion_jax.measured.vetoes import Judgement
from adhesion_jax.report.rendering import Sections, sections_of, sentences_of
from adhesion_jax.report.text import filled
from adhesion_jax.wording import listed

#: The residual is said to have structure if the likeness of its neighbours exceeds this number of
#: standard deviations.
_LIKENESS = 2.0

#: Least weight at which a curve is named as part of the answer.
_LEAST_NAMED = 0.005

#: Curves are told apart if their log densities differ by this multiple of its standard error.
_APART = 2.0

#: Autocorrelation, run scatter, slow level and departure below this are not worth a number.
_SLIGHT = 5e-4


def verdict(
    measured: Measured,
    citation: str,
    fits: Mapping[str, MeasuredFit],
    not_fitted: Mapping[str, Sequence[str]],
    left: Residual,
    answer: Answer,
    judgement: Judgement,
    slip: SlipNoise,
    runs: int,
    comparisons: Sequence[Comparison],
    groups: Mapping[str, Group],
    in_vain: Sequence[str] | None,
    mixed: Comparison | None,
) -> Sections:
    """The verdict in sentences under titles: what forbids an answer comes first.

    `left` is the residual of the curve with the largest log density, and `in_vain` are the columns
    whose groups were looked at without one that predicts; `mixed` are the levels by a column that
    nobody named and that predicts them.
    """
    ranked = best_first(fits)
    best, second = fits[ranked[0]], fits[ranked[min(1, len(ranked) - 1)]]
    by_part = best.left_out - second.left_out
    departure, at_slip = _departure(best)
    table = measured.table
    slips, adhesion = table[measured.slip], table["adhesion"]
    return sections_of(
        "identify.txt",
        measured=measured,
        citation=citation,
        fits=fits,
        not_fitted=not_fitted,
        left=left,
        answer=answer,
        judgement=judgement,
        slip=slip,
        runs=runs,
        groups=groups,
        in_vain=in_vain,
        ranked=ranked,
        warnings=[*filter(None, [different_rails(None, {}, mixed), judgement.warning])],
        braking=int(((slips < 0) & (adhesion < 0)).sum()),
        apart=int((slips * adhesion < 0).sum()),
        departure=departure,
        at_slip=at_slip,
        gain=best.log_density - second.log_density,
        gain_se=float(np.sqrt(by_part.size) * np.std(by_part)),
        weights=weights_of(answer),
        exact_fit=best.rms <= EXACT * np.sqrt(np.mean(left.adhesion**2)),
        compared=[(one, *_ends(one.table)) for one in comparisons],
        untrusted=[
            (name, reasons(fits[name]))
            for name in ranked
            if fits[name].status is not Status.TRUSTED
        ],
        exact=EXACT,
        cosines=COSINES,
        slight=_SLIGHT,
        most_alike=_LIKENESS,
        apart_errors=_APART,
    )


def _ends(table: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """The rows of the smallest and of the largest adhesion."""
    order = np.argsort(table["mu_max"].to_numpy())
    return table.iloc[order[0]], table.iloc[order[-1]]


def _departure(fit: MeasuredFit) -> tuple[float, float]:
    """How far the points leave the nearest curve where they do most, as a share; and the slip."""
    slip = np.linspace(0.02, 1.0, 50) * fit.law.span.largest
    alone = np.asarray(fit.curve(jnp.asarray(slip), fit.conditions))
    departure = (fit.law.at(slip).adhesion - alone) / np.abs(alone).max()
    most = int(np.argmax(np.abs(departure)))
    return float(departure[most]), float(slip[most])


def best_first(fits: Mapping[str, MeasuredFit]) -> list[str]:
    """The names of the curves, the one that predicts best first."""
    return sorted(fits, key=lambda name: -fits[name].log_density)


def weights_of(answer: Answer) -> str:
    """The weights of the curves that are worth a name, the heaviest first."""
    weights = {name: weight for name, weight in answer.weights.items() if weight >= _LEAST_NAMED}
    heaviest = sorted(weights, key=lambda name: -weights[name])
    return listed([f"{name} {weights[name]:.2f}" for name in heaviest])


def in_lines(sections: Sections) -> str:
    """The verdict for a terminal and a text file."""
    return "\n".join(filled(f"{title}: {' '.join(sentences)}") for title, sentences in sections)


def reasons(fit: MeasuredFit) -> list[str]:
    """Every reason why a fit may not be trusted, as sentences; that of TRUSTED if there is none."""
    parameters = zip(fit.curve.free, fit.parameters, fit.on_bound, fit.no_influence, strict=True)
    told = sentences_of("reasons.txt", fit=fit, known=Status, parameters=[*parameters])
    return told or [Status.TRUSTED.sentence]


def different_rails(
    comparison: Comparison | None, groups: Mapping[str, Group], mixed: Comparison | None
) -> str:
    """What is said before one answer for rows of different rails; empty for most measurements."""
    return " ".join(sentences_of("rails.txt", comparison=comparison, groups=groups, mixed=mixed))
