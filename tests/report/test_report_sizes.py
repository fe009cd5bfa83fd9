"""What the verdict says of the size of an effect, and where along its column it lies."""

import numpy as np
import pytest
from discovery_examples import two_effects, unexplained

from adhesion_jax.report.discovery.figures import _dependences
from adhesion_jax.report.discovery.words import acts_on, verdict


def told(factor, values=None, effect=None, **changes):
    """What the verdict says of the size of a structure along a column of these factors."""
    findings = unexplained()
    shown = findings.dependences[0]._replace(
        column="hour",
        unit="",
        values=np.linspace(0, 24, len(factor)) if values is None else values,
        factor=np.asarray(factor, dtype=float),
        **changes,
    )
    effect = effect or findings.unexplained[0]
    words = verdict(findings._replace(unexplained=(effect,), dependences=(shown,)))
    return words.partition("adjusted p = 0.0031")[2].partition(")")[0].removeprefix("; ")


def test_a_hump_is_told_from_its_lowest_to_its_highest():
    """A tide of 12 % about the level of the curve changes adhesion by 1 - 0.88/1.12."""
    hours = np.linspace(0, 24, 97)
    assert told(1 + 0.12 * np.cos(2 * np.pi * (hours - 16) / 24)) == (
        "adhesion is 21.4 % lower where hour is 4 than where it is 16"
    )
    # So it is about another level, from which one without the effect is far.
    assert told(1.3 + 0.12 * np.cos(2 * np.pi * (hours - 16) / 24)) == (
        "adhesion is 16.9 % lower where hour is 4 than where it is 16"
    )


def test_what_acts_in_one_place_is_told_beside_none():
    hours = np.linspace(0, 24, 97)
    assert told(1 - 0.25 * np.exp(-((hours - 8) ** 2))) == (
        "adhesion is 25.0 % lower where hour is 8 than without it"
    )


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (
            [0.99, 0.985, 1.046, 0.985],
            "adhesion is 6.2 % higher where hour is 3 than its median over the other labels",
        ),
        (
            [1.01, 0.8, 1.0, 1.0],
            "adhesion is 20.0 % lower where hour is 2 than its median over the other labels",
        ),
        # One that is as far from the others as they are from each other does not stand out.
        ([0.88, 1.0, 1.0, 1.12], "adhesion is 21.4 % lower where hour is 1 than where it is 4"),
        ([0.9, 1.0], "adhesion is 10.0 % lower where hour is 1 than where it is 2"),
    ],
)
def test_the_label_that_stands_out_is_told_beside_the_others(factor, said):
    assert told(factor, labels=tuple("1234"[: len(factor)])) == said


def test_a_step_is_told_with_its_place_and_a_rise_without():
    time = np.linspace(0, 9553, 80)
    step = 1 + 0.0885 * (1 + np.tanh((time - 4366) / 300))
    rises = "adhesion rises by 17.7 % as hour goes from 0 to 9553"
    words, _, place = told(step, time).partition(", most of it near ")
    assert words == rises
    assert float(place) == pytest.approx(4366, abs=80)
    assert told(1 + 0.177 * time / 9553, time) == rises
    # A third of the range is no place.
    assert told(1 + 0.177 * np.clip((time - 3000) / 3200, 0, 1), time) == rises


def test_what_stretches_the_slip_scale_has_a_size_at_a_slip():
    stretched = unexplained().unexplained[0]._replace(acts_on="slip")
    scale = "stretches the slip scale: the initial slope and the place of the peak move"
    line = np.linspace(1.0, 0.9, 20)
    falls = "at slip 0.013 adhesion falls by 10.0 % as hour goes from 0 to 24"
    assert told(line, effect=stretched, at_slip=0.0126) == f"{scale}, the maximum stays; {falls}"
    # What reads as 0.0 % is no size.
    assert told(1 + 0.001 * line, effect=stretched) == f"{scale}, the maximum stays"


@pytest.mark.parametrize("part", ["level", "fall", "offset"])
def test_the_maximum_stays_only_if_nothing_else_acts_on_it(part):
    humidity = two_effects().effects[0]._replace(acts_on="slip", refined_on=("slip", "shift"))
    scale = "stretches the slip scale: the initial slope and the place of the peak move"
    assert acts_on(humidity) == f"{scale}, the maximum stays"
    assert acts_on(humidity._replace(refined_on=("slip", part))) == scale


def test_what_two_columns_do_together_is_told_at_the_median_of_one_of_them():
    findings, name = unexplained(), "product:gust*hour"
    pair = findings.unexplained[0]._replace(name=name, covariates=("gust", "hour"))
    along = findings.dependences[0]._replace(effect=name, unit="", values=np.linspace(0, 24, 50))
    shown = [
        along._replace(column=column, factor=np.linspace(1.0, last, 50))
        for column, last in (("gust", 0.95), ("hour", 0.9))
    ]
    joint = findings._replace(unexplained=(pair,), dependences=tuple(shown))
    falls = "adhesion falls by 10.0 % as hour goes from 0 to 24"
    assert f"; with gust at its median, {falls};" in verdict(joint)
    titles = [axis.get_title(loc="left").split("\n")[1] for axis in _dependences(joint).axes[:2]]
    assert titles == ["with hour at its median", "with gust at its median"]
