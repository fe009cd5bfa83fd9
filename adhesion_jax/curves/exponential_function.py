"""The exponential function as a polynomial, for what evaluates it at many numbers at once."""

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

_PER_LOG_2 = 1.4426950408889634

#: log 2 in two parts: the product of the first, whose last bits are zero, with a whole number
#: below 2^11 is exact.
_LOG_2 = 0.6931471805582987
_LOG_2_REST = 1.6465949582897082e-12

#: Of r^0 to r^11 in a polynomial of least largest relative error, 3.6e-18, from e^r for
#: |r| <= log(2)/2; the first two are held at those of the series.
COEFFICIENTS = (
    1.0,
    1.0,
    0.5000000000000011,
    0.16666666666666413,
    0.04166666666653027,
    0.008333333333494319,
    0.0013888888943594882,
    0.0001984126950680199,
    2.48014931392209e-05,
    2.7557586254993705e-06,
    2.7630232820207277e-07,
    2.5000073399388296e-08,
)

#: Beyond these arguments the result is 0 or infinite.
_LEAST, _MOST = -708.4, 709.9

#: The last 12 bits of 1.5 2^52 + 1025 - n are the exponent of the number 2^(2 - n).
_TO_EXPONENT = 1.5 * 2.0**52 + 1025
_BITS_BEHIND = 52


@jax.custom_jvp
@jax.jit
def exp(x: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """e^x = 2^n e^r with the whole number n = round(x/log 2), e^r by a polynomial of degree 11.

    The relative error is below 2^-52, one unit in the last place, for -708 <= x <= 709.78; below
    -708.05 the result is 0, above 709.79 it is infinite, and of NaN it is NaN. In another precision
    than double it is that of jax.

    It takes .8 times as long as that of jax in a loop that the compiler turns into vectors. The
    last step is a division, exact because it is by a power of two: without it the compiler would
    take the polynomial for cheap, and compute it again in every loop that uses the result, which
    doubles the time of an elastic axle. The coefficients are quadrupled because 2^(2 - n) is a
    number for every n of the range.
    """
    if x.dtype != jnp.float64:
        return jnp.exp(x)
    x = lax.clamp(_LEAST, x, _MOST)
    n = lax.round(x * _PER_LOG_2, lax.RoundingMethod.TO_NEAREST_EVEN)
    r = (x - n * _LOG_2) - n * _LOG_2_REST
    bits = lax.bitcast_convert_type(_TO_EXPONENT - n, jnp.int64) << _BITS_BEHIND
    divisor = lax.bitcast_convert_type(bits, jnp.float64)
    quadrupled = jnp.full_like(r, 4 * COEFFICIENTS[-1])
    for coefficient in COEFFICIENTS[-2::-1]:
        quadrupled = quadrupled * r + 4 * coefficient
    return quadrupled / divisor


@exp.defjvp
def _derivative(
    primals: tuple[Float[Array, "*shape"]], tangents: tuple[Float[Array, "*shape"]]
) -> tuple[Float[Array, "*shape"], Float[Array, "*shape"]]:
    value = exp(*primals)
    return value, value * tangents[0]
