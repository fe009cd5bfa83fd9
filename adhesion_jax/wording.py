"""How a number, a number with its error, and a list are written for a reader."""

import math
from collections.abc import Sequence


def number(value: float) -> str:
    """A number with four digits; empty if it is not finite."""
    if not math.isfinite(value):
        return ""
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"


def percent(share: float) -> str:
    """A share from 0 to 1 in per cent, with two digits of it, or of what it lacks to all."""
    value = 100 * share
    least = min(value, 100 - value)
    decimals = max(0, 1 - math.floor(math.log10(least))) if least > 0 else 0
    written = f"{value:.{decimals}f}"
    return f"{written.rstrip('0').rstrip('.') if decimals else written} %"


def plus_minus(value: float, standard_error: float) -> str:
    """`value ± error`, rounded to two digits of the error.

    Empty if the value is NaN; the value alone if it is infinite or has no finite error.
    """
    if math.isnan(value):
        return ""
    if math.isinf(value):
        return f"{value:g}"
    if not math.isfinite(standard_error):
        return number(value)
    if standard_error <= 1e-9 * abs(value) or standard_error == 0:
        return f"{value:.6g}"
    decimals = max(0, 1 - math.floor(math.log10(standard_error)))
    if decimals > 7:  # a row of zeros is hard to read
        return f"{value:.4g} ± {standard_error:.2g}"
    return f"{value:.{decimals}f} ± {standard_error:.{decimals}f}"


def p_value(value: float, least: float = 0.0) -> str:
    """A p with two digits, `<= 0.0005` at the `least` that its test can show; empty if NaN.

    No p is 0: one below 1e-300 is told as that. Smaller ones are not told apart, since a processor
    that takes subnormal numbers for 0, which some libraries ask for when they are loaded, has none.
    """
    if not math.isfinite(value):
        return ""
    if value < 1e-300:
        return "< 1e-300"
    return f"<= {least:.2g}" if value == least else f"{value:.2g}"


def p_is(value: float, least: float = 0.0) -> str:
    """`p = 0.003`, or `p <= 0.0005`."""
    written = p_value(value, least)
    return f"p {written}" if written.startswith("<") else f"p = {written}"


def listed(words: Sequence[str], conjunction: str = "and") -> str:
    """`a, b and c`."""
    return f" {conjunction} ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)


def capital(words: str) -> str:
    """The words as the start of a sentence."""
    return words[:1].upper() + words[1:]
