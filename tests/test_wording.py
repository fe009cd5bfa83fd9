import math

import pytest

from adhesion_jax.wording import listed, number, p_is, percent, plus_minus


@pytest.mark.parametrize(
    ("value", "error", "written"),
    [
        (0.95123, 0.0031, "0.9512 ± 0.0031"),
        (-2.04, 0.2, "-2.04 ± 0.20"),
        (12345.6, 230.0, "12346 ± 230"),
        (1.23456e-9, 3.2e-11, "1.235e-09 ± 3.2e-11"),
        (0.3, 0.0, "0.3"),
        (1234567.0, 1e-7, "1.23457e+06"),
        (2.0, math.nan, "2"),
        (math.inf, 0.1, "inf"),
        (-math.inf, math.nan, "-inf"),
        (math.nan, 1.0, ""),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value, error, written):
    assert plus_minus(value, error) == written


def test_numbers_have_four_digits_and_lists_an_and():
    assert [number(x) for x in (0.123456, 106712.0, 2.5e-7, math.inf)] == [
        "0.1235",
        "106712",
        "2.5e-07",
        "",
    ]
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert listed(["a", "b"], "or") == "a or b"


def test_a_share_has_two_digits_of_itself_or_of_what_it_lacks_to_all():
    shares = [0.0, 1.0, 0.2, 0.05, 0.0344, 0.000123, 0.123, 0.9997]
    assert [percent(share) for share in shares] == [
        "0 %",
        "100 %",
        "20 %",
        "5 %",
        "3.4 %",
        "0.012 %",
        "12 %",
        "99.97 %",
    ]


def test_a_p_is_never_nought():
    told = [p_is(0.0123), p_is(0.0005, 0.0005), p_is(0.0, 0.0005), p_is(5e-300), p_is(5e-310)]
    assert told == ["p = 0.012", "p <= 0.0005", "p < 1e-300", "p = 5e-300", "p < 1e-300"]
