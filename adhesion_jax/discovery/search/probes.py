"""Probes: what an effect that is not in a model would change in its prediction."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import BASES, Scalar
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    in_noise_units,
    raw_changes,
    size_of,
)
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.model.program import PROBES, changes, pack, words_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.effects import Covariate, Effect, ShapeTerm
from adhesion_jax.effects.shape import ACTS_ON
from adhesion_jax.programs import kept

#: Size of the constant by which the derivative with respect to a `ShapeTerm` is taken.
_NUDGE = 1e-4


def directions_of(
    fitted: Fitted, probes: Sequence[Effect]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Component of each probe orthogonal to the model's Jacobian, and the residual treated alike.

    Returns a mask of the probes that can be tested [probes]; the components [points, probes], each
    of length one, zero for the others; and the residual, data less prediction [points]. Points are
    those with weight, signals in units of the noise.
    """
    used = np.asarray(fitted.setting.noise.weight).ravel() > 0
    signals = in_noise_units(fitted.setting, _added(fitted, probes))
    flat = signals.reshape(len(probes), -1)[:, used].T
    jacobian = fitted.jacobian.reshape(fitted.jacobian.shape[0], -1)[:, used].T
    basis, upper = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))
    basis = basis[:, np.abs(np.diag(upper)) > 1e-9]
    before = np.linalg.norm(flat, axis=0)
    flat = flat - basis @ (basis.T @ flat)
    left = np.linalg.norm(flat, axis=0)
    testable = (left > rules.LEAST_SHARE_LEFT * before) & (before > 0) & np.isfinite(left)
    flat = np.where(testable, flat / np.where(testable, left, 1.0), 0.0)
    residual = -fitted.residual.ravel()[used]
    return testable, flat, residual - basis @ (basis.T @ residual)


def _added(fitted: Fitted, probes: Sequence[Effect]) -> np.ndarray:
    """The change of the prediction by each probe, [probes, runs, points].

    For a `ShapeTerm` it is its function of the columns times the derivative of the prediction with
    respect to a constant in its place: exact to first order if no effect has a memory.
    """
    found = np.empty((len(probes), *fitted.adhesion.shape))
    others = [place for place, probe in enumerate(probes) if not isinstance(probe, ShapeTerm)]
    if others:
        found[others] = raw_changes(fitted, [probes[place] for place in others])
    if len(others) == len(probes):
        return found
    constants = [Covariate(_NUDGE, 0.0, 1.0, column="", acts_on=acts_on) for acts_on in ACTS_ON]
    changed = dict(zip(ACTS_ON, raw_changes(fitted, constants) / _NUDGE, strict=True))
    for place, probe in enumerate(probes):
        if isinstance(probe, ShapeTerm):
            found[place] = changed[probe.acts_on] * _term(fitted.setting.problem, probe)
    return found


def _term(problem: Problem, probe: ShapeTerm) -> np.ndarray:
    """The values of the term's function of the columns, [runs, points].

    They do not depend on any fit and are kept in `problem.terms`.
    """
    kind = type(probe)
    names = [getattr(probe, word) for word in words_of(kind)]
    numbers = {name: float(getattr(probe, name)) for name in kind.PARAMETERS}
    key = (kind, *names, *numbers.values())
    if key not in problem.terms:
        columns = [problem.data.columns[problem.columns.index(name)] for name in names]
        problem.terms[key] = np.asarray(_log_factor(kind, numbers, columns))
    return problem.terms[key]


@kept(static=(0,))
def _log_factor(
    kind: type[ShapeTerm],
    numbers: Mapping[str, Scalar],
    columns: Sequence[Float[Any, "runs points"]],
) -> Float[Array, "runs points"]:
    """The function of columns of a term of that kind; compiled once for all names of columns."""
    places = [str(place) for place in range(len(columns))]
    named: Mapping[str, Any] = {**numbers, **dict(zip(words_of(kind), places, strict=True))}
    return kind(**named).log_factor(dict(zip(places, columns, strict=True)))


def compile_changes(setting: Setting, base: str) -> None:
    """Compiles the program that `screen` needs, for data of this shape."""
    adhesion = np.asarray(setting.problem.data.adhesion)
    model = pack(base, [1.0] * len(BASES[base].free), (), (), *size_of(base, ()))
    models = jax.tree.map(lambda leaf: np.stack([leaf] * PROBES), model)
    jax.block_until_ready(changes(models, setting.problem.data, adhesion))
