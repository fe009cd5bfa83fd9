"""What every room hands on: a record of slip and adhesion, and what is known of its curve."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import Curve


class Record(NamedTuple):
    """One block of one run; with a leading axis, all the blocks of it."""

    slip: Float[Array, "*blocks points"]
    adhesion: Float[Array, "*blocks points"]
    mask: Bool[Array, "*blocks points"]  # false: there is no such point
    fresh: Bool[Array, "*blocks points"]  # false: seen before, or no such point
    conditions: Mapping[str, Float[Array, "*blocks points"]]


#: The axes of `Scenario.run_axes` where the slips are the same in every run.
SHARED_SLIP: Any = Record(None, 0, None, None, {})  # type: ignore[arg-type]


class Known(eqx.Module):
    """What a scenario tells an identifier: the form of the curve, where to start and the box.

    The free parameters of `curve` hold the start; the others are known. `lower` and `upper`
    bound the free parameters, in their order.
    """

    curve: Curve
    lower: Float[Array, " free"]
    upper: Float[Array, " free"]
