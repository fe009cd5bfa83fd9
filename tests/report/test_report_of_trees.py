"""What reports say of effects of columns that boosted trees need, and how labels are drawn."""

from pathlib import Path

import numpy as np
import pandas as pd
from discovery_examples import two_effects, unexplained

from adhesion_jax.discovery.types import Candidate
from adhesion_jax.report.discovery.figures import _dependences, _ranking, shape_panels
from adhesion_jax.report.discovery.files import page
from adhesion_jax.report.discovery.residuals import residual_panels
from adhesion_jax.report.discovery.words import verdict
from adhesion_jax.report.rendering import page_markdown

OF_TREES = "of boosted trees that predict runs left out by its columns, for which it was found"
BY_THEIR_P = "is accepted by the p of the trees"


def test_the_p_of_trees_is_told_as_theirs_and_only_theirs():
    findings = two_effects()
    humidity, speed = findings.effects
    assert OF_TREES not in verdict(findings)
    assert BY_THEIR_P not in page_markdown(page(findings))
    trees = findings._replace(effects=(humidity._replace(by_trees=True), speed))
    assert f"humidity (adjusted p = 0.0011 {OF_TREES}; adhesion falls by" in verdict(trees)
    assert "slip velocity (adjusted p = 0.0023; " in verdict(trees)
    assert BY_THEIR_P in page_markdown(page(trees))


def test_labels_are_drawn_as_points_with_their_names():
    findings = unexplained()
    (shown,) = findings.dependences
    values, factor = np.arange(2.0), np.array([1.3, 0.8])
    labels = shown._replace(
        column="surface",
        values=values,
        factor=factor,
        low=factor - 0.1,
        high=factor + 0.1,
        labels=("ice", "sand"),
    )
    # A band without bounds, as where the curve alone is near 0, hides no curve.
    wide = shown._replace(low=shown.factor - 1e6, high=shown.factor + 1e6)
    figure = _dependences(findings._replace(dependences=(labels, wide)))
    first, second = figure.axes
    assert [text.get_text() for text in first.get_xticklabels()] == ["ice", "sand"]
    (container,) = first.containers
    np.testing.assert_array_equal(container.lines[0].get_ydata(), factor)
    assert first.get_xlabel() == "surface"
    assert len(second.lines) == 3  # 1, the curve, the deciles
    for low, high in (first.get_ylim(), second.get_ylim()):
        assert -0.5 < low < 0.7
        assert 1.4 < high < 2.5


def test_labels_that_begin_alike_have_places_of_their_own():
    findings = unexplained()
    (shown,) = findings.dependences
    factor = np.array([1.3, 0.8, 1.0])
    names = ("wet leaves on rail", "wet leaves on sleepers", "dry")
    bounds = {"low": factor - 0.1, "high": factor + 0.1}
    labels = shown._replace(column="surface", factor=factor, labels=names, **bounds)
    (axis,) = _dependences(findings._replace(dependences=(labels,))).axes
    (container,) = axis.containers
    np.testing.assert_array_equal(container.lines[0].get_xdata(), [0, 1, 2])
    drawn = [text.get_text() for text in axis.get_xticklabels()]
    assert drawn == ["wet leaves …", "wet leaves …", "dry"]


def test_the_shapes_of_labels_are_those_of_the_labels_that_most_points_have():
    findings = two_effects()
    surface = findings.effects[0]._replace(covariates=("axle",), acts_on="slip")
    codes = np.resize([0, 1, 1, 2, 2, 2, 3, 3, 3, 3], len(findings.points)).astype(float)
    names = ("oily", "damp", "clean", "iced")

    def legend(codes):
        case = findings._replace(
            points=findings.points.assign(axle=codes), effects=(surface,), named={"axle": names}
        )
        (axis,) = shape_panels(case).axes
        return [text.get_text() for text in axis.get_legend().get_texts()]

    assert legend(codes) == ["damp", "clean", "iced"]
    assert legend(np.minimum(codes, 1.0)) == ["oily", "damp"]


def test_a_round_of_columns_that_trees_need_has_no_threshold_and_says_so():
    of_trees = Candidate(1, "covariate:wind_mps", 2.2, 0.002, 9.0, 2.0, "accepted")
    findings = two_effects()
    humidity, speed = findings.effects
    findings = findings._replace(
        thresholds=(4.21,),
        ranking=(*[row for row in findings.ranking if row.round == 0], of_trees),
    )
    for axis in _ranking(findings).axes:  # of a threshold that is not known nothing is said
        assert axis.get_title(loc="left") in ("round 1", "round 2")
    trees = findings._replace(effects=(humidity._replace(by_trees=True), speed))
    first, second = _ranking(trees).axes
    assert first.get_title(loc="left") == "round 1"
    assert second.get_title(loc="left") == (
        "round 2, of columns that boosted trees need: accepted by the p of the trees"
    )
    dashed = [[line for line in axis.lines if len(line.get_xdata())] for axis in (first, second)]
    assert [line.get_xdata()[0] for line in dashed[0]] == [4.21]
    assert dashed[1] == []


def test_residuals_against_labels_are_drawn_over_their_names():
    panels = {axis.get_xlabel(): axis for axis in residual_panels(two_effects()).axes}
    names = [text.get_text() for text in panels["axle"].get_xticklabels()]
    assert names == ["leading", "second"]
    assert panels["axle"].get_xlim() == (-0.5, 1.5)
    numbers = panels["relative humidity (%)"].get_xticks()
    assert (np.diff(numbers) > 5).all()


def test_the_verdict_says_how_many_effects_were_false_in_the_study_that_is_kept():
    sets = pd.read_csv(Path(__file__).parents[2] / "results" / "strangers_sets.csv")
    caused = sets[sets["causes"] > 0]
    effects = caused["reported"].dropna().str.split("|").explode()
    # Of each of these sets one name is false; noise of the slip is there, and no effect.
    false, reported = caused["wrong beside"].sum(), (effects != "slip_noise").sum()
    assert (
        f"of {reported} effects reported on simulated campaigns that hide a cause {false} were "
        "false" in verdict(two_effects())
    )
