"""Judgement of the accepted effects: by the other base curves, and by the held-out runs."""

from collections.abc import Mapping, Sequence

import numpy as np

from adhesion_jax.curves import BASES
from adhesion_jax.discovery.model.bases import bic
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    in_noise_units,
    likeliest,
    nearly_fitted,
    noise_of,
    side_by_side,
    with_own_noise,
)
from adhesion_jax.discovery.model.noise import determinant, whitening
from adhesion_jax.discovery.model.problem import label_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import entry_of
from adhesion_jax.discovery.search.run_levels import followed
from adhesion_jax.discovery.search.state import (
    Accepted,
    Selection,
    all_but,
    parts_of,
    without,
)
from adhesion_jax.discovery.search.trials import OF_SIGNALS
from adhesion_jax.discovery.types import Doubt
from adhesion_jax.effects import Effect, kind_of
from adhesion_jax.effects.falling_friction import FallingFriction

#: Number of bootstrap samples of the held-out runs.
_DRAWS = 999

#: A bias beside noise of the slip: errors of the smoothed slip look like one.
_OF_NOISY_SLIP = Doubt(
    OF_SIGNALS,
    "A bias of the slip or of the torque, or what the noise of the slip leaves: the slip that "
    "adhesion is held against is itself estimated from a noisy signal, and where it bends faster "
    "than the estimate can follow, the error looks like a bias; it is not counted as an effect. A "
    "wheel speed with less noise, or a longer log, would tell them apart.",
)


def doubtful(state: Selection) -> tuple[Selection, Sequence[Doubt]]:
    """The state without the effects of slip alone that may be something else, and the doubts.

    Such an effect is removed if some base curve hardly improves with it, and an error of the
    signals also where the slip is noisy.
    """
    doubts = []
    for effect in state.accepted:
        if not _of_slip_alone(state, effect):
            continue
        rest = tuple(other for other in state.accepted if other.name != effect.name)
        if state.setting.problem.slip_noise is not None and effect.name in OF_SIGNALS:
            doubts.append(_OF_NOISY_SLIP)
            state = without(state, rest)
            continue
        for base, fitted in state.fits.items():
            values = fitted.base_values.tolist()
            less = likeliest(fitted.setting, base, values, parts_of(rest))
            if less.total - fitted.total < rules.GAIN_ON_EVERY_CURVE:
                doubts.append(_doubt(effect.name, state.base, base))
                state = without(state, rest)
                break
    return state, doubts


def _doubt(name: str, base: str, other: str) -> Doubt:
    """The doubt about an effect of slip alone that improves the curve `base` but hardly `other`."""
    names = OF_SIGNALS if name in OF_SIGNALS else (name,)
    what = "A bias of the slip or of the torque" if name in OF_SIGNALS else f"An effect of {name}"
    but = "too little to be sure" if base == other else f"hardly that of {other}"
    tell = (
        "Runs in traction and in braking, and runs with slips near zero, would tell them apart: "
        "a bias moves the two branches of the curve against each other at zero slip, a shape does "
        "not."
        if name in OF_SIGNALS
        else "Runs of the same slips at different speeds would tell them apart."
    )
    return Doubt(
        names,
        f"{what}, or another shape of the curve: {name} would improve the fit of {base}, but "
        f"{but}; it is not counted as an effect. {tell}",
    )


def curve_doubts(state: Selection) -> tuple[Doubt, ...]:
    """The doubt whether friction falls by the curve or by an effect on another curve; or none.

    It is raised if the curve chosen falls with the slip velocity by itself, and another one with
    the effect of falling friction is nearly as likely.
    """
    plain = [fitted for name, fitted in state.fits.items() if not BASES[name].NEEDS]
    starts = FallingFriction.starts({})
    falls = entry_of(kind_of(starts[0]), starts, state.setting.problem)
    if not BASES[state.base].NEEDS or not plain:
        return ()
    if any(effect.family == falls.family for effect in state.accepted):
        return ()
    other = min(plain, key=bic)
    values, own = other.base_values.tolist(), parts_of(state.accepted)

    def with_fall(start: Effect) -> Fitted:
        return nearly_fitted(other.setting, other.base, values, (*own, start))

    best = min(side_by_side(with_fall, falls.starts), key=lambda fitted: fitted.total)
    lacking = other.total - state.fitted.total
    gained = other.total - with_own_noise(best).total
    enough = rules.SHARE_OF_FALLING_CURVE * lacking
    if lacking < rules.GAIN_ON_EVERY_CURVE or gained < enough:
        return ()
    return (
        Doubt(
            (falls.name,),
            f"Friction falls with the slip velocity, in the curve or as an effect: {state.base}, "
            f"which was chosen, falls by itself. Its log likelihood is {lacking:.2g} above that of "
            f"{other.base} alone, and {lacking - gained:.2g} above that of {other.base} with "
            f"{falls.name}. It is not counted as an effect, for the curve has it; --base "
            f"{other.base} searches for it as one. Runs of the same slips at different speeds "
            "would tell them apart.",
        ),
    )


def undecided(state: Selection) -> tuple[Doubt, ...]:
    """The doubt about the best significant candidate of the last round that was not accepted."""
    last = [row for row in state.ranking if row.round == state.ranking[-1].round]
    taken = {member for effect in state.accepted for member in effect.members}
    # A column of an accepted effect asks for another form of that effect, not for another effect.
    taken |= {f"covariate:{name}" for effect in state.accepted for name in effect.covariates}
    standing = [
        row
        for row in last
        if row.p_adjusted <= rules.SIGNIFICANT
        and row.gain > 0
        and row.name.split(" (")[0] not in taken
    ]
    if not standing or any(row.decision == "accepted" for row in last):
        return ()
    row = max(standing, key=lambda row: row.gain)
    name = row.name.split(" (")[0]
    seen = f"{row.name} stands out in the residual (adjusted p = {row.p_adjusted:.2g}), but"
    if state.fitted.log and row.gain > rules.SURE_BUT_FOR_A_STRETCH * row.gain_se:
        why = (
            f"{seen} what it explains lies in one stretch of the only run: it is not counted as an "
            "effect. A single event agrees with every column that was different there; a second "
            "run over the same line would decide."
        )
    else:
        why = (
            f"{seen} taken into the law it does not raise the likelihood of runs left out by "
            f"enough ({row.gain:.2g} with a standard error of {row.gain_se:.2g}): it is not "
            "counted as an effect. It may be weak, or a proxy for a cause that has no column here; "
            "more runs in which it varies would decide."
        )
    return (Doubt((name,), why),)


def level_doubts(state: Selection, seed: int) -> tuple[Doubt, ...]:
    """The doubt about the column that the remaining levels of the runs follow, if there is one."""
    fitted, problem = state.fitted, state.setting.problem
    scatter = float(state.setting.noise.run_scatter)
    if problem.blocks or scatter < rules.NOTICEABLE_RUN_SCATTER:
        return ()
    weight = np.asarray(state.setting.noise.weight)
    used = weight.sum(axis=1) > 0
    law = fitted.adhesion * np.sqrt(weight)
    left = (np.asarray(problem.data.adhesion) * np.sqrt(weight) - law) * law
    levels = left.sum(axis=1)[used] / (law**2).sum(axis=1)[used]
    means = (np.asarray(problem.data.columns) * weight).sum(axis=2)[:, used]
    means = means / weight.sum(axis=1)[used]
    columns = {
        label_of(name, problem.measured): means[place] for place, name in enumerate(problem.columns)
    }
    found = followed(levels, columns, seed)
    if found is None or found.p > rules.SIGNIFICANT:
        return ()
    return (
        Doubt(
            (found.column,),
            f"The remaining level of each run follows {found.column}: a smooth function of this "
            f"column explains {100 * found.explained:.0f} % of the variance (adjusted p = "
            f"{found.p:.2g}). No effect of {found.column} was accepted that also agrees with what "
            "happens within the runs: it may act in a form that is not in the catalogue, or "
            "together with an error of the signals.",
        ),
    )


def _of_slip_alone(state: Selection, effect: Accepted) -> bool:
    """Whether an effect is a function of the slip, so that another base curve may replace it."""
    if effect.name in OF_SIGNALS:
        return True
    varying = state.setting.problem.varying
    return (
        not effect.generic
        and all(
            name in ("slip_ratio", "time_s") or name not in varying for name in effect.covariates
        )
        and effect.family == FallingFriction.FAMILY
    )


def confirmed(
    state: Selection, held_out: np.ndarray, seed: int
) -> tuple[Selection, Mapping[str, str]]:
    """The state without effects that do not raise the likelihood of the held-out runs.

    `held_out` is a mask [runs]. Returns also the reasons by effect name. Refinements that fail the
    same test are removed without a message, since they are no claims of their own.
    """
    words: dict[str, str] = {}
    if not held_out.any():
        return state, words
    number = 0
    while number < len(state.accepted):
        effect = state.accepted[number]
        rest = all_but(state.accepted, number)
        raised = _raised(state, rest, held_out, seed)
        if raised >= rules.LEAST_SHARE_RAISED:
            number += 1
            continue
        words[effect.name] = (
            f"{effect.name} was found on three quarters of the runs, but does not improve the "
            f"prediction of the others (it does in {100 * raised:.0f} % of bootstrap samples of "
            "them); it is not counted as an effect."
        )
        state = without(state, rest)
    for number in range(len(state.accepted)):
        for part in reversed(range(1, len(state.accepted[number].parts))):
            effect = state.accepted[number]
            less = effect._replace(parts=effect.parts[:part] + effect.parts[part + 1 :])
            rest = (*state.accepted[:number], less, *state.accepted[number + 1 :])
            if _raised(state, rest, held_out, seed) < rules.LEAST_SHARE_RAISED:
                state = without(state, rest)
    return state, words


def _raised(state: Selection, rest: Sequence[Accepted], held_out: np.ndarray, seed: int) -> float:
    """Share of bootstrap samples of held-out runs that are likelier than with `rest` alone."""
    values = state.fitted.base_values.tolist()
    less = likeliest(state.setting, state.base, values, parts_of(rest))
    gains = (_losses(less, held_out) - _losses(state.fitted, held_out))[held_out]
    draws = np.random.default_rng([seed, 17]).integers(gains.size, size=(_DRAWS, gains.size))
    return float(np.mean(gains[draws].sum(axis=1) > 0))


def _losses(fitted: Fitted, held_out: np.ndarray) -> np.ndarray:
    """Minus the log likelihood of each held-out run, [runs]; 0 for the others.

    The noise is the likeliest one for these runs. With the noise of the fitted runs a single run,
    whose columns lie outside what was fitted, would decide.
    """
    problem = fitted.setting.problem
    weight = np.where(held_out[:, None], problem.points, 0.0)
    residual = np.asarray(problem.data.adhesion) - fitted.adhesion
    noise = noise_of(
        problem, fitted.setting.noise._replace(weight=weight), residual, fitted.adhesion
    )
    setting = Setting(problem, noise, fitted.adhesion)
    white = in_noise_units(setting, residual[None])[0]
    return 0.5 * (white**2).sum(axis=1) + np.asarray(
        determinant(whitening(setting.noise, setting.level))
    )
