"""Which of many cases of a test are run how often."""

import pytest


def lanes(cases, always, thorough=0, long=0):
    """`always` of the cases in every run, `long` more before a change lands, the others by night.

    Of these `thorough` are marked so, and the rest slow. The chosen ones are spread over the cases,
    and stay the same.
    """
    cases = list(cases)
    places = sorted(range(len(cases)), key=lambda place: 0.6180339887 * place % 1)
    marks = dict.fromkeys(places, pytest.mark.slow)
    marks |= dict.fromkeys(places[: always + long + thorough], pytest.mark.thorough)
    marks |= dict.fromkeys(places[: always + long], pytest.mark.long)
    marks |= dict.fromkeys(places[:always], ())
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=marks[place])
        for place, case in enumerate(cases)
    ]
