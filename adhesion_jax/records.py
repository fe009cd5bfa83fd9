"""The types that all parts exchange: a record of slip and adhesion, and what is known of it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import equinox as eqx
import numpy as np
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import SLIP_LIMIT, Conditions, Curve, Scalar


class Record(NamedTuple):
    """One block of one run; with a leading axis, all the blocks of it.

    Attributes:
        slip: a ratio.
        adhesion: force over load.
        mask: false for padding.
        fresh: false for points that were seen before and for padding.
        conditions: columns in SI units, by name.
    """

    slip: Float[Array, "*blocks points"]
    adhesion: Float[Array, "*blocks points"]
    mask: Bool[Array, "*blocks points"]
    fresh: Bool[Array, "*blocks points"]
    conditions: Mapping[str, Float[Array, "*blocks points"]]


def record_axes(slip: int | None, adhesion: int | None, conditions: Any) -> Any:
    """A record of axis numbers for `jax.vmap`; mask and freshness are shared by all runs."""
    return Record(slip, adhesion, None, None, conditions)  # type: ignore[arg-type]


#: `Scenario.run_axes` if the slips are the same in every run, and if they differ.
SHARED_SLIP, OWN_SLIP = record_axes(None, 0, {}), record_axes(0, 0, {})


#: What bounds may be given as: sequences of numbers become arrays.
if TYPE_CHECKING:
    _Bounds: TypeAlias = Any
else:
    _Bounds = Array | np.ndarray


def _precise(bounds: Any) -> Any:
    """A sequence of numbers as an array of NumPy: it needs no device and is in double precision.

    The rails are made when their module is imported, whatever precision jax has then.
    """
    return np.asarray(bounds, float) if isinstance(bounds, (list, tuple)) else bounds


class Known(eqx.Module):
    """What an identifier is told: the form of the curve, where to start, the box, what is asked.

    Attributes:
        curve: its free parameters hold the start, the others are known.
        lower: bounds of the free parameters, in their order.
        upper: the same from above.
        conditions: those of the peak, a scalar for each column that the curve needs.
        slip_limit: up to which the peak is asked; a velocity where slip is one.
        by_sample: whether a method is given one sample at a time and followed at each of them; a
            block of a run is then what lies between two reports.
        asked: the quantities; the parameters of the curve come with those of its peak.
    """

    curve: Curve
    lower: Float[_Bounds, " free"] = eqx.field(converter=_precise)
    upper: Float[_Bounds, " free"] = eqx.field(converter=_precise)
    conditions: Conditions = eqx.field(default_factory=dict)
    slip_limit: Scalar = SLIP_LIMIT
    by_sample: bool = eqx.field(default=False, static=True)
    asked: tuple[str, ...] = eqx.field(default=("mu_max", "slip_opt"), static=True)
