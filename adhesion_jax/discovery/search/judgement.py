"""What was found is doubted twice: by every other base curve, and by runs it was not found on."""

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
from adhesion_jax.discovery.search.catalogue import entry_of
from adhesion_jax.discovery.search.run_levels import followed
from adhesion_jax.discovery.search.screening import SIGNIFICANT
from adhesion_jax.discovery.search.state import Accepted, Selection, parts_of, without
from adhesion_jax.discovery.search.trials import OF_SIGNALS
from adhesion_jax.discovery.types import Doubt
from adhesion_jax.effects import Effect, kind_of
from adhesion_jax.effects.falling_friction import FallingFriction

#: Half a chi-square that an effect of the slip alone must reach on every base curve: p = 6e-5.
_SURE = 8.0

#: An effect is as good as a curve that has it where it gains this share of what the curve does.
_AS_GOOD = 0.75

#: A gain of so many standard errors is sure, whatever is asked of it besides.
_SURELY = 1.645

#: Less scatter of the levels of runs than this share is not looked into.
_SCATTER = 0.005

#: A bias beside noise of the slip: what the smoothed slip misses of the true one looks like it.
_OF_NOISY_SLIP = Doubt(
    OF_SIGNALS,
    "A bias of the slip or of the torque, or what the noise of the slip leaves: the slip that "
    "adhesion is held against is itself estimated from a noisy signal, and where it bends faster "
    "than the estimate can follow, the error looks like a bias; it is not counted as an effect. A "
    "wheel speed with less noise, or a longer log, would tell them apart.",
)


def doubtful(state: Selection) -> tuple[Selection, Sequence[Doubt]]:
    """Without the effects of slip alone that another base curve, or noise of the slip, explains.

    These become doubts.
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
            if less.total - fitted.total < _SURE:
                doubts.append(_doubt(effect.name, state.base, base))
                state = without(state, rest)
                break
    return state, doubts


def _doubt(name: str, base: str, other: str) -> Doubt:
    """An effect that improves one curve and hardly another, and what would tell."""
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


def of_curve(state: Selection) -> tuple[Doubt, ...]:
    """That a curve was chosen which falls with slip velocity, where falling friction is as good.

    Then friction falls in the curve, or as an effect on another curve.
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
    if lacking < _SURE or gained < _AS_GOOD * lacking:
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
    """The strongest candidate that stood out of the residual at last and yet did not become one."""
    last = [row for row in state.ranking if row.round == state.ranking[-1].round]
    taken = {member for effect in state.accepted for member in effect.members}
    # A column of an effect that was found asks for another form of it, not for another effect.
    taken |= {f"covariate:{name}" for effect in state.accepted for name in effect.covariates}
    standing = [
        row
        for row in last
        if row.p_adjusted <= SIGNIFICANT and row.gain > 0 and row.name.split(" (")[0] not in taken
    ]
    if not standing or any(row.decision == "accepted" for row in last):
        return ()
    row = max(standing, key=lambda row: row.gain)
    name = row.name.split(" (")[0]
    seen = f"{row.name} stands out of the residual (adjusted p = {row.p_adjusted:.2g}), but"
    if state.fitted.log and row.gain > _SURELY * row.gain_se:
        why = (
            f"{seen} what it explains lies in one stretch of the only run: it is not counted as an "
            "effect. What happened once goes with every column that was different there; a second "
            "run of the same line would tell."
        )
    else:
        why = (
            f"{seen} taken into the law it does not raise the likelihood of runs left out by "
            f"enough ({row.gain:.2g} with a standard error of {row.gain_se:.2g}): it is not "
            "counted as an effect. It may be weak, or stand for something that has no column here; "
            "more runs in which it varies would tell."
        )
    return (Doubt((name,), why),)


def of_levels(state: Selection, seed: int) -> tuple[Doubt, ...]:
    """The column that what is left of the levels of the runs follows, if there is one."""
    fitted, problem = state.fitted, state.setting.problem
    if problem.blocks or float(state.setting.noise.run_scatter) < _SCATTER:
        return ()
    weight = np.asarray(state.setting.noise.weight)
    used = weight.sum(axis=1) > 0
    law = fitted.adhesion * weight
    left = (np.asarray(problem.data.adhesion) * weight - law) * law
    levels = left.sum(axis=1)[used] / (law**2).sum(axis=1)[used]
    means = (np.asarray(problem.data.columns) * weight).sum(axis=2)[:, used]
    means = means / weight.sum(axis=1)[used]
    columns = {
        label_of(name, problem.measured): means[place] for place, name in enumerate(problem.columns)
    }
    found = followed(levels, columns, seed)
    if found is None or found.p > SIGNIFICANT:
        return ()
    return (
        Doubt(
            (found.column,),
            f"What is left of the level of each run follows {found.column}: a smooth function of "
            f"it explains {100 * found.explained:.0f} % of the variance (adjusted p = "
            f"{found.p:.2g}). No effect of {found.column} was accepted that also agrees with what "
            "happens within the runs: it may act in a form that is not in the catalogue, or "
            "together with an error of the signals.",
        ),
    )


def _of_slip_alone(state: Selection, effect: Accepted) -> bool:
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


def vetoed(
    state: Selection, held_out: np.ndarray, seed: int
) -> tuple[Selection, Mapping[str, str]]:
    """Without what does not raise the likelihood of the runs held out; why, by name of effect.

    A refinement of an effect that does not is dropped without a word: it was no claim.
    """
    words: dict[str, str] = {}
    if not held_out.any():
        return state, words
    place = 0
    while place < len(state.accepted):
        effect = state.accepted[place]
        rest = tuple(other for other in state.accepted if other is not effect)
        raised = _raised(state, rest, held_out, seed)
        if raised >= 0.5:
            place += 1
            continue
        words[effect.name] = (
            f"{effect.name} was found on three quarters of the runs, but does not improve the "
            f"prediction of the others (it does in {100 * raised:.0f} % of bootstrap samples of "
            "them); it is not counted as an effect."
        )
        state = without(state, rest)
    for place in range(len(state.accepted)):
        for part in reversed(range(1, len(state.accepted[place].parts))):
            effect = state.accepted[place]
            less = effect._replace(parts=effect.parts[:part] + effect.parts[part + 1 :])
            rest = (*state.accepted[:place], less, *state.accepted[place + 1 :])
            if _raised(state, rest, held_out, seed) < 0.5:
                state = without(state, rest)
    return state, words


def _raised(state: Selection, rest: Sequence[Accepted], held_out: np.ndarray, seed: int) -> float:
    """The share of bootstrap samples of the runs held out that the state predicts better."""
    values = state.fitted.base_values.tolist()
    less = likeliest(state.setting, state.base, values, parts_of(rest))
    gains = (_losses(less, held_out) - _losses(state.fitted, held_out))[held_out]
    draws = np.random.default_rng([seed, 17]).integers(gains.size, size=(999, gains.size))
    return float(np.mean(gains[draws].sum(axis=1) > 0))


def _losses(fitted: Fitted, held_out: np.ndarray) -> np.ndarray:
    """Minus the log likelihood of each run held out, [runs].

    The noise is that of greatest likelihood for these runs: one run at the edge of what a model
    has seen would else decide by how far it lies outside the scatter of the runs within.
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
