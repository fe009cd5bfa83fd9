"""Coordinates of a fit: shares of the physical box, those of a positive box logarithmic."""

from typing import Any

import numpy as np
from jaxtyping import Float

from adhesion_jax.curves import Curve


def parameters_at(curve: Curve, share: Any) -> Any:
    """The parameters at shares of the physical box, [free ...], of NumPy or of jax."""
    described = [curve.PARAMETERS[name] for name in curve.free]
    shape = (-1, *(1,) * (share.ndim - 1))
    lower = np.reshape([p.lower for p in described], shape)
    upper = np.reshape([p.upper for p in described], shape)
    logarithmic = lower > 0
    ratio = np.where(logarithmic, upper, 1.0) / np.where(logarithmic, lower, 1.0)
    width = np.where(logarithmic, 0.0, upper - lower)
    return lower * ratio**share + width * share


def stretch_at(curve: Curve, share: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
    """The derivatives of the parameters by the shares of the box."""
    described = [curve.PARAMETERS[name] for name in curve.free]
    lower, upper = np.array([[p.lower, p.upper] for p in described]).T
    ratio = np.where(lower > 0, upper, 1.0) / np.where(lower > 0, lower, 1.0)
    return np.where(lower > 0, parameters_at(curve, share) * np.log(ratio), upper - lower)
