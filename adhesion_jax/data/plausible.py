"""Whether values are of the size that their unit gives, and agree with what else a log tells."""

from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Float

from adhesion_jax.data.columns import COLUMNS, UNDECIDED, named
from adhesion_jax.data.understanding import Taken
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed, number, percent

#: Bins of the abscissa, and the fewest points of one.
_BINS, _OF_A_BIN = 12, 5

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
    """Rows of bins of equal width in the root of slip; one of too few rows joins the next.

    At the end it joins the one before.
    """
    order = np.argsort(slip, kind="stable")
    place = (_BINS * np.sqrt(slip[order] / max(float(slip.max()), 1e-300))).astype(int)
    begins = [0]
    for end in (np.flatnonzero(np.diff(place)) + 1).tolist():
        if min(end - begins[-1], slip.size - end) >= _OF_A_BIN:
            begins.append(end)
    return np.split(order, begins[1:])


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


#: A speed in km/h over the same in m/s, and the relative deviation up to which a ratio is taken for
#: that.
_KMH, _NEAR = 3.6, 0.15

#: A change of speed, m/s^2, that no train reaches for this time in s, not even by track brakes.
_HARDEST, _FOR_S = 4.0, 2.0

#: Rolling radii of the wheels of rail vehicles, m.
_RADII = (0.2, 0.8)

#: Blocks of rows in which a distance or a change of speed is summed, and the fewest that tell.
_BLOCKS, _FEWEST = 50, 5

#: Changes of speed below this, m/s, say nothing of the unit of an acceleration.
_CHANGED = 0.5


#: A tenth of all slips rarely exceeds this ratio.
_LARGE_SLIP = 0.3

#: A tenth of all slips exceeds this ratio only if they are in per cent.
_WHOLE_SLIP = 1.5

#: The adhesion that nine rows in ten do not exceed is of this size, from oil to a racing tyre.
_ADHESIONS = (1e-3, 5.0)
_OF_ADHESION = (*UNDECIDED["force"], "motor_torque_Nm", *UNDECIDED["load"])


def unusual(columns: Mapping[str, np.ndarray], taken: Mapping[str, Taken]) -> Iterator[str]:
    """Warnings where a column is of the size that another unit would give."""
    for name, source in taken.items():
        if name not in COLUMNS or name not in columns or not columns[name].size:
            continue
        least, most = COLUMNS[name].usual
        largest = float(np.max(np.abs(columns[name])))
        unit = COLUMNS[name].unit
        if not least <= largest <= most:
            yield (
                f"Check the unit of column {source.column}: its largest value, {largest:g} {unit}, "
                f"is unusual for this quantity ({least:g} to {most:g} {unit})."
            )
    slip = taken.get("slip_ratio")
    if slip is not None and _may_be_percent(slip) and _reached(columns["slip_ratio"]) > _LARGE_SLIP:
        yield (
            f"Check the unit of column {slip.column}: a tenth of its slips exceed {_LARGE_SLIP}, "
            "which is unusual for ratios (they may be in per cent)."
        )


def refuse_other_units(
    columns: Mapping[str, np.ndarray], taken: Mapping[str, Taken]
) -> Iterator[str]:
    """InputError that asks for a unit where slip or adhesion, [rows], have the size of another one.

    Where the user said the units, it is a warning.
    """
    slip, adhesion = taken.get("slip_ratio"), taken.get("adhesion")
    if slip is not None and _may_be_percent(slip) and _reached(columns["slip_ratio"]) > _WHOLE_SLIP:
        raise InputError(
            f"a tenth of the slips of column {slip.column} exceed {_WHOLE_SLIP} (give the slip as "
            f'a ratio, not in per cent, or say --column "slip={slip.column} [%]"; where it is a '
            f'ratio, --column "slip={slip.column} [1]")'
        )
    said = no_contact_has(columns["adhesion"])
    if not said:
        return
    sources = [adhesion] if adhesion else [taken[name] for name in _OF_ADHESION if name in taken]
    if all(one.said for one in sources):
        least, most = _ADHESIONS
        yield f"Check the units: {said}, which is unusual ({least:g} to {most:g})."
        return
    answers = [
        f'--column "{COLUMNS[one.name].plain}={named(one.column).stem} [UNIT]"' for one in sources
    ]
    advice = f"check the units of force and load; say them by {listed(answers)}"
    if adhesion is not None:
        advice = (
            "give it as force over load, not in per cent, or say "
            f'--column "adhesion={adhesion.column} [%]"; where it is right, '
            f'--column "adhesion={adhesion.column} [1]"'
        )
    raise InputError(f"{said}, which no contact has ({advice})")


def no_contact_has(adhesion: np.ndarray) -> str:
    """What is said of the size of an adhesion, [rows], where no contact has it; else empty."""
    level = _reached(adhesion)
    least, most = _ADHESIONS
    if level == 0.0 or least <= level <= most:
        return ""
    return f"the adhesion is {number(level)} or less in nine of ten rows"


def slip_beside_speeds(columns: Mapping[str, np.ndarray], taken: Mapping[str, Taken]) -> list[str]:
    """A sentence where a measured slip ratio is not that of the two speeds beside it, [rows]."""
    names = ("slip_ratio", "wheel_speed_mps", "vehicle_speed_mps")
    if "slip_ratio" not in taken or not {*names} <= {*columns}:
        return []
    slip, wheel, train = (columns[name] for name in names)
    moves = train > 0
    computed = wheel[moves] / train[moves] - 1
    clear = np.abs(computed) >= max(_reached(computed), np.finfo(float).tiny)
    if np.count_nonzero(clear) < _FEWEST:
        return []
    factor = float(np.median(slip[moves][clear] / computed[clear]))
    if abs(factor - 1) <= _NEAR:
        return []
    return [
        f"Check the unit of column {taken['slip_ratio'].column}: where the slip is large, it is "
        f"{number(factor)} times wheel speed / train speed - 1, by the two speeds of this file."
    ]


def _may_be_percent(slip: Taken) -> bool:
    """Whether a slip that is taken for a ratio was not said to be one."""
    return not slip.said and slip.conversion.factor == 1.0


def _reached(values: np.ndarray) -> float:
    """The size that nine rows in ten do not exceed."""
    return float(np.quantile(np.abs(values), 0.9))


def speed_warnings(columns: Mapping[str, np.ndarray], taken: Mapping[str, Taken]) -> Iterator[str]:
    """Sentences on the train speed where its unit must be wrong.

    The first that can be told of: the distance run, by positions; the change of the speed, by an
    acceleration; how fast a speed in m/s changes. A train of constant speed whose log has none of
    these tells nothing of the unit.
    """
    own = taken.get("vehicle_speed_mps")
    check = f"Check the unit of column {own.column if own else 'vehicle_speed_mps'}:"
    speed, time = (columns.get(name) for name in ("vehicle_speed_mps", "time_s"))
    if speed is None or time is None or speed.size < 2:
        return
    step = np.diff(time)
    usual = np.median(step[step > 0]) if (step > 0).any() else np.inf
    joined = (step > 0) & (step < 10 * usual)  # within a run, and without a gap
    if not joined.any():
        return
    block = np.arange(step.size) * _BLOCKS // step.size

    def sums(values: np.ndarray) -> np.ndarray:
        return np.bincount(block, np.where(joined, values, 0.0), _BLOCKS)

    # What the speed says, and what was told, with the least that counts.
    ways = {}
    if "position_m" in columns:
        moved = np.abs(sums(np.diff(columns["position_m"])))
        ways["the distance that its positions tell"] = sums(speed[1:] * step), moved, 1.0
    if "acceleration_mps2" in columns:
        told = sums(columns["acceleration_mps2"][1:] * step)
        ways["the change that its acceleration tells"] = sums(np.diff(speed)), told, _CHANGED
    for what, (by_speed, told, least) in ways.items():
        factor = _typical(by_speed, told, least)
        if factor is not None:
            if wrong := wrong_unit(factor):
                yield f"{check} it gives {factor:.2g} times {what}, as if {wrong}."
            return
    within = max(round(_FOR_S / usual), 1)
    if speed.size <= within:
        return
    lasted = time[within:] - time[:-within]
    whole = np.isclose(lasted, within * usual, rtol=0.1)
    rate = np.abs(speed[within:] - speed[:-within])[whole] / (within * usual)
    hardest = float(np.quantile(rate, 0.999)) if rate.size else 0.0
    # In km/h already it is that of a car, or of a rig.
    if hardest > _HARDEST and not (own and own.conversion.factor < 1):
        yield (
            f"{check} the speed of the train changes by {hardest:.2g} m/s in a second, for "
            f"{_FOR_S:g} s, which no train does (it may be in km/h)."
        )


def _typical(values: np.ndarray, told: np.ndarray, least: float) -> float | None:
    """The median of values as multiples of what was told, if enough of them exceed the least."""
    clear = (np.abs(values) > least) & (told != 0)
    if np.count_nonzero(clear) < _FEWEST:
        return None
    return float(np.median(values[clear] / told[clear]))


def wrong_unit(factor: float) -> str:
    """Which units make a speed this multiple of what it is, as a clause; empty where none do."""
    if abs(factor / _KMH - 1) < _NEAR:
        return "km/h were taken for m/s"
    if abs(factor * _KMH - 1) < _NEAR:
        return "m/s were taken for km/h"
    return ""


def radius_warnings(radius: float) -> list[str]:
    """A sentence on a rolling radius in m that was identified, if no rail wheel has it."""
    least, most = _RADII
    if least <= radius <= most:
        return []
    return [
        f"Check the units of train speed and rotation: a rolling radius of {radius:.3g} m is "
        f"unusual for a rail wheel ({least:g} to {most:g} m)."
    ]
