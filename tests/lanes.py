"""Which of many cases of a test are run how often."""

import pytest


def lanes(cases, always, thorough=0):
    """`always` of the cases in every run, `thorough` more and the others, marked slow, by night.

    The chosen ones are spread over the cases, and stay the same.
    """
    cases = list(cases)
    places = sorted(range(len(cases)), key=lambda place: 0.6180339887 * place % 1)
    marks = dict.fromkeys(places, pytest.mark.slow)
    marks |= dict.fromkeys(places[: always + thorough], pytest.mark.thorough)
    marks |= dict.fromkeys(places[:always], ())
    return [
        pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=marks[place])
        for place, case in enumerate(cases)
    ]
