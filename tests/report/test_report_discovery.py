"""Reports of a discovery: what they say, that they say it alike, and that nothing breaks them."""

import base64
import csv
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from discovery_examples import (
    DOUBT,
    NASTY,
    OPINION,
    TORSION,
    doubted,
    nasty,
    null,
    points,
    two_effects,
    unexplained,
)
from discovery_examples import errors as made_errors
from matplotlib.image import imread

from adhesion_jax.curves import BASES
from adhesion_jax.data.events import events_of
from adhesion_jax.data.reading import to_measured
from adhesion_jax.discovery.search.screening import least_p
from adhesion_jax.discovery.types import Dependence, Interval, Opinion
from adhesion_jax.effects.saved import load_law
from adhesion_jax.effects.shape import ACTS_ON
from adhesion_jax.files import staged
from adhesion_jax.report.discovery.figures import (
    _dependences,
    _errors,
    adhesion_over_slip,
    shape_panels,
)
from adhesion_jax.report.discovery.files import (
    DISCOVERY_FILES,
    page,
    printed,
    report_json,
    write_discovery,
)
from adhesion_jax.report.discovery.residuals import level_panels, residual_panels
from adhesion_jax.report.discovery.tables import (
    effects_table,
    errors_frame,
    errors_table,
    level_columns,
    residual_columns,
)
from adhesion_jax.report.discovery.words import (
    acts_on,
    error,
    humanised,
    in_brackets,
    percent,
    verdict,
)
from adhesion_jax.report.rendering import page_markdown
from adhesion_jax.wording import p_value, plus_minus

EXAMPLES = {
    "null": null,
    "two": two_effects,
    "unexplained": unexplained,
    "nasty": nasty,
    "doubted": doubted,
}
NAN = float("nan")


class Page(HTMLParser):
    """What a browser would show, what it would load, and whether every element is closed."""

    VOID = ("meta", "img")

    def __init__(self, html):
        super().__init__()
        self.open, self.loads, self.names, self.words = [], [], [], []
        self.feed(html)
        self.close()
        self.text = " ".join(" ".join(self.words).split())

    def handle_starttag(self, tag, attrs):
        self.names.append(tag)
        self.loads += [value for name, value in attrs if name in ("src", "href", "srcset", "data")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Every example, written once."""
    folders = {}
    for name, example in EXAMPLES.items():
        out = tmp_path_factory.mktemp(name)
        with staged(out, DISCOVERY_FILES) as stage:
            write_discovery(stage, example())
        folders[name] = out
    return folders


def rendered(folder):
    html = Page((folder / "report.html").read_text(encoding="utf-8")).text
    # What a reader of the rendered page sees of the escapes.
    markdown = (folder / "report.md").read_text(encoding="utf-8").replace("\\", "")
    return html, " ".join(markdown.split())


@pytest.mark.parametrize("name", EXAMPLES)
def test_only_files_of_its_own(written, name):
    names = {file.name for file in written[name].iterdir()}
    assert names <= set(DISCOVERY_FILES)
    of_runs, of_effects = {"levels.png"}, {"dependence.png"}
    left_out = {
        "two": set(),
        "null": {"predictions.csv", "shapes.png"} | of_runs | of_effects,
        "doubted": {"predictions.csv", "shapes.png"} | of_effects,
    }
    others = {"predictions.csv", "shapes.png"} | of_runs
    no_log = {"metadata.json", "events.png"}
    assert set(DISCOVERY_FILES) - names == left_out.get(name, others) | no_log


@pytest.mark.parametrize("name", EXAMPLES)
def test_json_is_plain_and_keeps_its_contract(written, name):
    findings = EXAMPLES[name]()
    report = report_json(findings)
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert json.loads((written[name] / "report.json").read_text()) == report
    keys = "format base noise_floor rmse effects unexplained doubts second_opinion warnings"
    assert list(report) == keys.split()
    assert report["format"] == 5
    told = ["train", "cross_validation", *(["test"] if findings.test else [])]
    assert list(report["rmse"]) == told
    assert all(list(pair) == ["before", "after"] for pair in report["rmse"].values())
    keys = ["name", "candidates", "covariates", "acts_on", "parameters", "p_adjusted", "rmse_after"]
    assert all(list(effect) == keys for effect in report["effects"])
    assert all(list(effect) == ["axis", *keys] for effect in report["unexplained"])
    for effect in (*report["effects"], *report["unexplained"]):
        assert effect["acts_on"] in ("level", "slip", "fall")
        assert effect["candidates"][0] == effect["name"]
        for parameter in effect["parameters"].values():
            assert list(parameter) == ["value", "low", "high", "unit"]


def test_json_of_the_examples():
    report = report_json(two_effects())
    assert report["base"] == "burckhardt"
    assert report["rmse"]["test"] == {"before": 0.01588, "after": 0.01031}
    assert report["effects"][1]["candidates"] == [
        "slip_speed",
        "falling_friction",
        "contact_heating",
    ]
    held = report["effects"][0]["parameters"]["reference"]
    assert held == {"value": 61.0, "low": None, "high": None, "unit": "%"}
    (structure,) = report_json(unexplained())["unexplained"]
    assert structure == {
        "axis": "covariate:relative_humidity_pct",
        "name": "covariate:relative_humidity_pct",
        "candidates": ["covariate:relative_humidity_pct"],
        "covariates": ["relative_humidity_pct"],
        "acts_on": "level",
        "parameters": {"k1": {"value": 0.0231, "low": 0.0112, "high": 0.0345, "unit": "1"}},
        "p_adjusted": 0.0031,
        "rmse_after": 0.01044,
    }
    assert [effect["acts_on"] for effect in report["effects"]] == ["level", "fall"]
    assert (report["doubts"], report["second_opinion"]) == ([], None)
    doubtful = report_json(doubted())
    assert doubtful["doubts"] == [
        {"names": ["slip_bias", "torque_offset"], "sentence": DOUBT.sentence}
    ]
    assert doubtful["second_opinion"] == {
        "columns": ["wind_mps", "temperature_C"],
        "explained": 0.124,
        "error": 0.021,
        "p": 0.0003,
    }
    assert report_json(nasty())["effects"][0]["covariates"] == [NASTY]


def test_a_class_that_leaves_its_name_out_is_reported_with_it():
    findings = two_effects()
    others = findings.effects[1]._replace(candidates=("falling_friction",))
    report = report_json(findings._replace(effects=(others,)))
    assert report["effects"][0]["candidates"] == ["slip_speed", "falling_friction"]


ERROR_ALONE = (
    "The error of burckhardt on runs not used for fitting (cross-validation, 24 runs) is 0.01012 "
    "[0.00942, 0.01095], and the noise floor is 0.01002."
)


BY_CHANCE = (
    "Each p is adjusted for everything that was looked at, and an effect is reported only if it "
    "is at most 0.01: where nothing is missing about 1 search in 100 reports one, and of 248 "
    "effects reported on simulated campaigns that hide a cause 8 were false; 0.0005 is the "
    "smallest p that 1,999 patterns of signs of the runs can show."
)


def test_verdict_of_effects():
    assert verdict(two_effects()) == (
        "What burckhardt lacks here: humidity (adjusted p = 0.0011; adhesion falls by 14.8 % as "
        "relative humidity (%) goes from 25 to 95); exponential loss with slip velocity (adjusted "
        "p = 0.0023; deepens or flattens the fall beyond the peak; adhesion "
        "falls by 10.5 % as vehicle speed (m/s) goes from 5.131 to 39.61; the data cannot tell "
        "exponential loss with slip velocity from falling friction or contact heating). On runs "
        "not used for fitting (test set, 8 runs) the error falls from 0.01588 to 0.01031 "
        "[0.00972, 0.01104], which removes 57.8 % [49.5, 63.9] of the squared error; the noise "
        f"floor is 0.01002. {BY_CHANCE}"
    )


def test_a_p_at_the_least_that_signs_can_show_is_told_as_such():
    findings = two_effects()
    humidity, speed = findings.effects
    least = findings._replace(effects=(humidity._replace(p_adjusted=0.0005), speed))
    assert "humidity (adjusted p <= 0.0005;" in verdict(least)
    assert [row[1] for row in effects_table(least).rows if row[1]] == ["<= 0.0005", "0.0023"]
    # Of eight runs there are 127 patterns of signs but their own.
    eight = least._replace(least_p=least_p(8))
    assert "; 0.0078 is the smallest p that 127 patterns of signs" in verdict(eight)
    assert "humidity (adjusted p = 0.0005;" in verdict(eight)


def test_what_was_stated_has_no_p():
    findings = two_effects()
    humidity, speed = findings.effects
    stated = findings._replace(effects=(humidity._replace(p_adjusted=np.nan), speed))
    told = verdict(stated)
    assert told.startswith(
        "What burckhardt lacks here: exponential loss with slip velocity (adjusted"
    )
    assert told.endswith(" Adhesion falls as the air becomes more humid.")
    # Alone it is told as well, and nothing is said to be missing for it.
    alone = verdict(findings._replace(effects=stated.effects[:1], unexplained=()))
    assert "lacks here" not in alone
    assert "Adhesion falls as the air becomes more humid." in alone
    assert next(row[1] for row in effects_table(stated).rows) == ""


def test_verdict_says_where_an_effect_acts():
    findings = two_effects()
    humidity, speed = findings.dependences
    values = np.linspace(0, 1000, 51)
    patch = 1 - 0.25 * np.exp(-(((values - 400) / 50) ** 2))
    place = humidity._replace(column="position_m", unit="m", values=values, factor=patch)
    assert "adhesion is 25.0 % lower where position (m) is 400 than without it" in verdict(
        findings._replace(dependences=(place, speed))
    )


def test_verdict_never_says_that_adhesion_falls_by_more_than_all_of_it():
    findings = two_effects()
    humidity, speed = findings.dependences
    values = np.linspace(0.002, 0.17, 50)
    near_zero = humidity._replace(
        column="slip_ratio", unit="1", values=values, factor=1 - 0.0077 / values
    )
    told = verdict(findings._replace(dependences=(near_zero, speed)))
    assert "adhesion has the other sign where slip ratio (1) is 0.002" in told
    assert not re.search(r"\d{3}\.\d %", told)


def test_verdict_says_which_parameter_stands_at_its_bound():
    findings = two_effects()
    humidity, speed = findings.effects
    assert "range that is searched" not in verdict(findings)
    name = next(iter(humidity.parameters))
    at = humidity._replace(
        at_bound=(name,),
        parameters={**humidity.parameters, name: Interval(200.0, -76.8, 476.8)},
        units={**humidity.units, name: "%"},
    )
    said = verdict(findings._replace(effects=(at, speed)))
    assert f"Of humidity {name} at 200 % stands at an end of the range that is searched" in said


def test_verdict_of_nothing():
    assert verdict(null()) == (
        "Nothing that these data could show is missing from burckhardt (the strongest of 2 "
        f"candidates, humidity, has adjusted p = 0.17). {ERROR_ALONE}"
    )
    assert verdict(null()._replace(ranking=())) == (
        f"Nothing that these data could show is missing from burckhardt. {ERROR_ALONE}"
    )


def test_verdict_says_what_the_curve_itself_has_of_a_column():
    findings = two_effects()
    humidity, speed = findings.dependences
    of_curve = speed._replace(
        effect=findings.base,
        values=np.array([4.0, 10.0]),
        factor=np.array([1.0, 0.9]),
        low=np.array([1.0, 0.87]),
        high=np.array([1.0, 0.94]),
        at_slip=0.21,
    )
    assert "by itself" not in verdict(findings)
    assert verdict(findings._replace(dependences=(of_curve, humidity, speed))) == (
        f"{verdict(findings)} The curve burckhardt depends on vehicle_speed_mps by itself, most at "
        "slip 0.21: there adhesion at 10 m/s is 90.0 % [87.0, 94.0] of that at 4 m/s. That is a "
        "part of the curve, and no cause is named for it."
    )


@pytest.mark.parametrize(("range_", "alone"), [(3.9, False), (4.1, True)])
def test_a_factor_of_four_times_the_usual_range_has_a_panel_of_its_own_scale(range_, alone):
    findings = two_effects()
    first = findings.dependences[0]._replace(
        values=np.array([0.0, 1.0]),
        factor=np.array([1.0, 2.0]),
        low=np.array([0.9, 1.9]),
        high=np.array([1.1, 2.1]),
        labels=(),
    )
    large = first._replace(factor=np.array([1.0, 1.0 + range_]))
    figure = _dependences(findings._replace(dependences=(first, large, first)))
    one, other, third = figure.axes
    assert one.get_ylim() == third.get_ylim()
    assert (one.get_ylim() != other.get_ylim()) == alone
    assert other.get_ylim()[1] > 1 + range_
    assert (one.get_ylim()[1] < 1 + range_) == alone
    # Numbers stand beside each panel whose scale is not that of its neighbour on the left.
    shown = [axis.yaxis.get_tick_params()["labelleft"] for axis in figure.axes]
    assert shown == [True, alone, alone]


def test_verdict_says_how_braking_differs():
    findings = two_effects()
    braking = findings.dependences[0]._replace(
        effect="braking over traction",
        column="slip_ratio",
        values=np.array([0.05, 0.1, 0.2]),
        factor=np.array([0.9, 0.7, 0.8]),
        low=np.array([0.85, 0.68, 0.7]),
        high=np.array([0.95, 0.73, 0.9]),
        at_slip=0.1,
        told=1,
    )
    (axis,) = _dependences(findings._replace(dependences=(braking,))).axes
    assert axis.get_title(loc="left") == "braking over traction"
    assert verdict(findings._replace(dependences=(braking,))).endswith(
        "The curve burckhardt is another one in braking, most surely at slip 0.1: there adhesion "
        "by the law is 70.0 % [68.0, 73.0] of that in traction. That is a part of the curve, and "
        "no cause is named for it."
    )
    added = findings.effects[0]._replace(acts_on="offset")
    findings = findings._replace(effects=(added, *findings.effects[1:]), dependences=(braking,))
    assert "adhesion by the law, its offsets included, is 70.0 % [68.0, 73.0]" in verdict(findings)


def test_nothing_is_not_said_of_what_was_significant_and_did_not_hold():
    ranking = tuple(
        row._replace(p_adjusted=0.0005, decision="no gain in cross-validation")
        for row in null().ranking
    )
    assert verdict(null()._replace(ranking=ranking)) == (
        "No effect is claimed, but humidity stands out among 2 candidates (adjusted p <= 0.0005) "
        "and was not accepted (no gain in cross-validation): something is missing that these data "
        "do not determine. Look at the residual against every column, and measure more runs that "
        f"differ in them. {ERROR_ALONE}"
    )


def test_verdict_of_doubts_and_of_the_second_opinion():
    trees = (
        "oosted trees predict 12.4 % ± 2.1 % of the squared residual (outliers cut) of rows that "
        "they were not fitted to, from wind_mps and temperature_C (p = 0.0003): something is "
        "missing that the law has no form for."
    )
    doubt = DOUBT.sentence[1:]
    assert verdict(doubted()) == f"No effect is claimed, but t{doubt} B{trees} {ERROR_ALONE}"
    assert verdict(doubted()._replace(doubts=())) == (
        f"No effect is claimed, but b{trees} {ERROR_ALONE}"
    )
    assert verdict(two_effects()._replace(opinion=OPINION, doubts=(DOUBT,))) == (
        f"{verdict(two_effects())} T{doubt} B{trees}"
    )
    unnamed = verdict(doubted()._replace(opinion=OPINION._replace(columns=())))
    assert "fitted to, from the slip itself, or columns that go together (p = 0.0003)" in unnamed
    hint = doubted()._replace(opinion=Opinion((), 0.07, 0.04, 0.03), doubts=())
    assert verdict(hint) == (
        "No effect is claimed, but boosted trees predict 7.0 % ± 4.0 % of the squared residual "
        "(outliers cut) of rows that they were not fitted to (p = 0.03). That is a hint: something "
        f"may be missing, or this is chance; more runs would decide. {ERROR_ALONE}"
    )


def test_a_correction_by_trees_is_offered_and_named_as_what_it_is():
    findings = two_effects()
    opinion = OPINION._replace(correction=lambda columns: columns["slip_ratio"])
    offered = verdict(findings._replace(opinion=opinion))
    assert "add --correct and --test (in Python correct=True and test)" in offered
    assert "--correct" not in verdict(findings._replace(opinion=OPINION))
    done = findings._replace(opinion=opinion, with_trees=made_errors(0.01588, 0.01019, 8))
    assert (
        "On top of the law they take its error on the test set from 0.01031 to 0.01019 [0.00961, "
        "0.01091]: a correction without a formula, from these columns, which is not in law.json."
    ) in verdict(done)
    assert errors_table(done).rows[-1][:2] == ("test, trees on top", "8")
    assert errors_frame(done)["data"].tolist()[-1] == "test, trees on top"
    assert report_json(done)["rmse"]["test_with_trees"] == {"before": 0.01588, "after": 0.01019}
    assert "test_with_trees" not in report_json(findings)["rmse"]
    beside = findings._replace(beside_trees=made_errors(0.01588, 0.01043, 8))
    assert errors_table(beside).rows[-1][:2] == ("test, trees for comparison", "8")
    assert report_json(beside)["rmse"]["test_beside_trees"] == {"before": 0.01588, "after": 0.01043}


def test_verdict_of_runs_that_scatter_more_than_their_points():
    noise = {"sigma": 0.005, "autocorrelation": 0.3, "run_scatter": 0.079}
    assert verdict(null()._replace(noise=noise)) == (
        "No effect is claimed, but the level of adhesion differs from run to run by 7.9 %, which "
        "no effect explains and which is more than the noise within the runs. "
        f"{ERROR_ALONE}"
    )
    calm = {**noise, "sigma": 0.0072}
    assert verdict(null()._replace(noise=calm)) == verdict(null())
    # What varies slowly within the runs is no matter of their levels.
    slow = {**noise, "run_scatter": 0.01, "slow_level": 0.078}
    assert verdict(null()._replace(noise=slow)) == verdict(null())
    assert verdict(null()._replace(noise={**slow, "run_scatter": 0.0})) == verdict(null())


def test_of_labels_the_verdict_names_those_that_differ_most():
    findings = unexplained()
    (effect,) = findings.unexplained
    weather = Dependence(
        effect.name,
        "weather",
        "1",
        np.arange(3.0),
        *(np.array([0.95, 0.7, 1.0]) for _ in range(3)),
        labels=("fog", "rain", "dry"),
    )
    words = verdict(findings._replace(dependences=(weather,)))
    assert "adhesion is 28.2 % lower where weather is rain than its median over" in words


def test_torsion_alone_is_not_praised():
    words = verdict(null()._replace(effects=(TORSION,)))
    assert words == (
        f"{verdict(null())} Torsion (adjusted p = 0.0004) is part of the noise: its phase differs "
        "from run to run, so that it improves no prediction."
    )
    both = two_effects()
    words = verdict(both._replace(effects=(*both.effects, TORSION)))
    assert words.startswith(verdict(both))
    assert words.count("orsion") == 1


def test_verdict_of_structure_without_a_cause():
    assert verdict(unexplained()) == (
        "No known cause is found to be missing, but there is unexplained structure against "
        "relative_humidity_pct (adjusted p = 0.0031; adhesion rises by 22.2 % as relative humidity "
        "(%) goes from 25 to 95); it is described by a non-parametric term, and no physical cause "
        "is claimed. On runs not used for fitting (cross-validation, 24 "
        "runs) the error falls from 0.01341 to 0.01044 [0.00984, 0.01118], which removes 39.4 % "
        f"[31.1, 45.5] of the squared error; the noise floor is 0.01002. {BY_CHANCE}"
    )


def test_a_correction_that_helps_nothing_unseen_is_not_praised():
    findings = two_effects()
    worse = findings.test._replace(after=Interval(0.017, 0.016, 0.018))
    words = verdict(findings._replace(test=worse))
    assert "the error does not fall: it rises from 0.01588 to 0.01700 [0.01600, 0.01800]" in words
    assert "removes" not in words
    same = findings.test._replace(after=findings.test.before)
    words = verdict(findings._replace(test=same))
    assert "the error stays at 0.01588 [0.01478, 0.01718]: no prediction improves" in words
    assert "removes" not in words


def test_the_error_with_the_slip_as_measured_is_told_where_it_was_smoothed():
    """The errors before and after the effects are both of the smoothed slip."""
    findings = two_effects()
    smoothing = made_errors(0.02857, 0.01588, 8)
    smooth = findings._replace(smoothing=smoothing)
    words = verdict(smooth)
    assert "the error falls from 0.01588 to 0.01031" in words
    assert (
        "With the slip as measured, before it was smoothed, the error of the curve alone is 0.0"
        in words
    )
    same = smooth._replace(test=findings.test._replace(after=findings.test.before))
    words = verdict(same)
    assert "the error falls from 0.02857 with the slip as measured to 0.01588 [0.01478" in words
    assert "with the smoothed one, which removes 69.1 %" in words
    grown = same._replace(smoothing=made_errors(0.0151, 0.01588, 8))
    words = verdict(grown)
    assert "the error does not fall: it is 0.01510 with the slip as measured and 0.01588" in words
    assert "removes" not in words
    assert "With the slip as measured, before it was smoothed, it is 0.02857." in verdict(
        null()._replace(smoothing=smoothing)
    )
    rows = [row[0] for row in errors_table(smooth).rows]
    assert rows == ["test, slip smoothed", "training", "cross-validation", "test"]
    assert report_json(smooth)["rmse"]["smoothing"] == {"before": 0.02857, "after": 0.01588}


def test_test_data_unlike_the_training_data_are_told():
    findings = two_effects()
    assert "unlike" not in verdict(findings)
    usual = findings.validation.after.value
    far = findings.test._replace(after=Interval(34 * usual, 30 * usual, 38 * usual))
    outside = "40 % of the test points have a larger slip than any training point (0.1)."
    words = verdict(findings._replace(test=far, foremost=(outside,)))
    assert words.endswith("or something acts in them that did not act there.")
    assert f"{outside} Of that on training runs left out, the error on the test set is 34" in words
    assert "their intervals do not touch" in words


def test_a_test_error_is_unlike_that_of_training_where_their_intervals_do_not_touch():
    findings = two_effects()
    usual, now = findings.validation, findings.test

    def said(**changes):
        return verdict(findings._replace(test=now._replace(**changes)))

    # Just apart, by 1.3 times; of seven runs the bootstrap is too narrow to say so.
    apart = Interval(1.3 * usual.after.value, 1.01 * usual.after.high, 0.02)
    assert "the error on the test set is 1.3 times after, and" in said(after=apart)
    assert "unlike" not in said(after=apart, runs=7)
    assert "unlike" not in said(after=apart._replace(low=usual.after.high))
    # A smaller error before is unlike training as well; a smaller one after is no reproach.
    less = Interval(0.5 * usual.before.value, 0.004, 0.99 * usual.before.low)
    assert "the error on the test set is 0.5 times before, and" in said(before=less)
    assert "unlike" not in said(after=Interval(0.005, 0.004, 0.006))


def test_blocks_of_one_run_are_called_blocks():
    findings = null()
    cut = findings.points.assign(run="block " + (findings.points["run"] + 1).astype(str))
    blocks = findings._replace(points=cut)
    assert "on blocks not used for fitting (cross-validation, 24 blocks) is" in verdict(blocks)
    for text in (printed(blocks), page_markdown(page(blocks))):
        assert " 24 runs" not in text
        assert "runs of" not in text
    tested = blocks._replace(test=two_effects().test)
    assert "(test set, 8 runs or blocks)" in verdict(tested)


@pytest.mark.parametrize("name", EXAMPLES)
def test_both_pages_tell_every_number(written, name):
    findings = EXAMPLES[name]()
    told = [error(findings.noise_floor), verdict(findings)]
    told += [f"{value:.4g}" for value in findings.noise.values()]
    for errors in (findings.train, findings.validation, findings.test):
        if errors is not None:
            told += [in_brackets(one, error) for one in (errors.before, errors.after)]
            told += [in_brackets(errors.removed, percent), str(errors.runs)]
    for effect in (*findings.effects, *findings.unexplained):
        told += [p_value(effect.p_adjusted), error(effect.rmse_after)]
        told += [" ".join(effect.sentence.split()), *effect.units.values()]
        told += [in_brackets(interval) for interval in effect.parameters.values()]
        told += [humanised(name) for name in effect.candidates if effect in findings.effects]
    for row in findings.base_parameters.to_dict("records"):
        told += [plus_minus(row[when], row[f"{when}_se"]) for when in ("before", "after")]
    for row in findings.ranking:
        told += [humanised(row.name), f"{row.z:.2f}", plus_minus(row.gain, row.gain_se)]
    told += [doubt.sentence for doubt in findings.doubts]
    if findings.opinion:
        told += ["Boosted trees predict 12.4 % ± 2.1 %", *findings.opinion.columns]
    for proposal in findings.proposals:
        told += [proposal.measurement, f"{proposal.power:.4g}"]
    told += [*findings.confounded, *findings.warnings]
    told += [" ".join(sentence.split()) for sentence in findings.untested]
    for text in rendered(written[name]):
        assert [words for words in told if words not in text] == []


@pytest.mark.parametrize("name", EXAMPLES)
def test_html_needs_nothing_beside_it(written, name):
    html = (written[name] / "report.html").read_text(encoding="utf-8")
    page = Page(html)
    assert page.open == []
    assert page.names.count("style") == 1
    assert not {"script", "link", "iframe", "object"} & set(page.names)
    pictures = [file for file in DISCOVERY_FILES if (written[name] / file).suffix == ".png"]
    drawn = [file for file in pictures if (written[name] / file).exists()]
    assert len(page.loads) == page.names.count("img") == len(drawn)
    assert all(load.startswith("data:image/png;base64,") for load in page.loads)
    text = re.sub(r"base64,[^\"]*", "", html)  # in which any four letters may stand
    assert "http" not in text
    assert "url(" not in text


def test_markup_in_a_name_stays_text(written):
    html = (written["nasty"] / "report.html").read_text(encoding="utf-8")
    assert "<script" not in html
    assert "&lt;script&gt;alert(1)" in html
    markdown = (written["nasty"] / "report.md").read_text(encoding="utf-8")
    for line in markdown.splitlines():
        outside_code = "".join(line.split("`")[::2]) if line.startswith("`") else line
        assert "<script" not in outside_code.replace("\\<", "")
    # A bar of the name does not make a column, nor does its line break make a row.
    rows = [line.replace("\\|", "") for line in markdown.splitlines() if line.startswith("|")]
    assert any("script" in row for row in rows)
    assert all(row.endswith("|") for row in rows)


def test_tables_of_the_markdown_are_aligned(written):
    lines = (written["two"] / "report.md").read_text(encoding="utf-8").splitlines()
    tables = "\n".join(lines).split("\n\n")
    tables = [part.splitlines() for part in tables if part.startswith("|")]
    assert len(tables) == 5
    for table in tables:
        assert len({len(line) for line in table}) == 1


@pytest.mark.parametrize("name", EXAMPLES)
def test_figures_are_not_blank(written, name):
    for file in written[name].glob("*.png"):
        image = imread(file)[..., :3]
        inked = np.mean(image.min(axis=2) < 0.9)
        assert 0.003 < inked < 0.5, file.name
        assert max(image.shape) < 1600, file.name


def test_tables_for_machines(written):
    with (written["two"] / "ranking.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows[:2]] == ["humidity", "slip_speed"]
    assert list(rows[0]) == ["round", "name", "z", "p_adjusted", "gain", "gain_se", "decision"]
    assert len(rows) == len(two_effects().ranking)
    assert (written["two"] / "predictions.csv").read_text().startswith("row,base,corrected\n")
    assert len(load_law(written["two"] / "law.json").effects) == 2


def test_panels_are_the_effects_first_and_only_what_varies():
    shown, varying = residual_columns(two_effects())
    assert shown == varying
    assert shown[:4] == ["relative_humidity_pct", "vehicle_speed_mps", "slip", "time_s"]
    assert "constant" not in shown
    findings = two_effects()
    many = findings.points.assign(**{f"x{k}": findings.points["wind_mps"] for k in range(20)})
    shown, varying = residual_columns(findings._replace(points=many))
    assert len(shown) == 12
    assert len(varying) == 28


def test_levels_are_drawn_against_what_differs_between_runs():
    findings = two_effects()
    shown, differing = level_columns(findings)
    assert shown == differing
    assert shown == [
        "relative_humidity_pct",
        "vehicle_speed_mps",
        "time_s",
        "normal_load_N",
        "temperature_C",
        "wind_mps",
        "axle",
    ]
    figure = level_panels(findings)
    assert [tick.get_text() for tick in figure.axes[6].get_xticklabels()] == ["leading", "second"]
    assert [axis.get_xlabel() for axis in figure.axes[:2]] == [
        "relative humidity (%)",
        "vehicle speed (m/s)",
    ]
    before, after = figure.axes[0].containers
    table = points()
    run = table[table["run"] == 3]
    for drawn, when in ((before, "before"), (after, "after")):
        x, y = (values[3] for values in drawn.lines[0].get_data())
        assert x == pytest.approx(run["relative_humidity_pct"].mean())
        assert y == pytest.approx(100 * (run["adhesion"] / run[when] - 1).mean())
        bar = drawn.lines[2][0].get_segments()[3][:, 1]
        assert np.ptp(bar) / 4 == pytest.approx(100 * 0.05 / np.sqrt(60))
    still = findings.levels[["run", "before", "after", "error"]].assign(one=1.0)
    for levels in (None, still):
        case = findings._replace(levels=levels)
        assert level_panels(case) is None
        assert "levels.png" not in page_markdown(page(case))


def test_errors_are_drawn_beside_the_floor_that_is_not_on_the_frame():
    findings = two_effects()
    (axis,) = _errors(
        findings._replace(test=findings.test._replace(runs=1), noise_floor=0.0095)
    ).axes
    low, high = axis.get_xlim()
    assert 0.0095 - low > 0.02 * (high - low)
    assert [text.get_text() for text in axis.get_yticklabels()] == [
        "training (24 runs)",
        "cross-validation (24 runs)",
        "test (1 run)",
    ]


def test_shapes_are_the_law_at_low_middle_and_high_values():
    findings = two_effects()
    (axis,) = shape_panels(findings).axes
    assert axis.get_legend().get_title().get_text() == "vehicle speed (m/s)"
    table = findings.points
    for line, quantile in zip(axis.get_lines(), (0.05, 0.5, 0.95), strict=True):
        slip, adhesion = (values[250] for values in line.get_data())
        speed = np.quantile(table["vehicle_speed_mps"], quantile, method="nearest")
        humidity = np.quantile(table["relative_humidity_pct"], 0.5, method="nearest")
        # Of the law: burckhardt under humidity, less exp(-c4 slip V).
        still = float(findings.law(jnp.asarray(slip), of_the_law(0.0, humidity)))
        moving = float(findings.law(jnp.asarray(slip), of_the_law(speed, humidity)))
        assert adhesion == pytest.approx(moving, rel=1e-9)
        slowest = 5.0  # speeds below those of the data are held at their edge
        assert moving / still == pytest.approx(np.exp(-0.0312 * slip * (speed - slowest)), rel=1e-6)
    level = [effect._replace(acts_on="level") for effect in findings.effects]
    assert shape_panels(findings._replace(effects=tuple(level))) is None


def of_the_law(speed, humidity):
    return {
        "vehicle_speed_mps": jnp.asarray(speed),
        "relative_humidity_pct": jnp.asarray(humidity),
        "time_s": jnp.asarray(3450.0),
    }


def test_what_an_effect_acts_on_is_said_of_columns_only():
    humidity, speed = two_effects().effects
    assert acts_on(humidity) == "acts on the level of the curve"
    assert acts_on(humidity._replace(acts_on="slip")) == (
        "stretches the slip scale: the initial slope and the place of the peak move, the maximum "
        "stays"
    )
    assert acts_on(speed) == "deepens or flattens the fall beyond the peak"
    assert acts_on(TORSION) == ""
    # There are words for whatever part of the curve a term acts on.
    assert len({acts_on(humidity._replace(acts_on=part)) for part in ACTS_ON}) == len(ACTS_ON)


def test_braking_one_slip_and_another_base_curve_are_drawn():
    findings = two_effects()
    points = findings.points
    braking = points.assign(slip=-points["slip"], adhesion=-points["adhesion"])
    noise = np.where(np.arange(len(points)) == 7, -0.004, points["slip"])
    law_before = replace(findings.law, curve=BASES["kiencke"], effects=())
    findings = findings._replace(law_before=law_before)
    for case, limits, begin in (
        (findings._replace(points=braking), (-0.208, 0.0), -0.208),
        (findings._replace(points=points.assign(slip=0.02)), (0.0, 0.0208), 0.02),
        (findings._replace(points=points.assign(slip=0.0)), (0.0, 1.0), 0.0),
        # Slip that noise alone has made negative has points, but no law.
        (findings._replace(points=points.assign(slip=noise)), (-0.00416, 0.208), 0.0),
    ):
        axis = adhesion_over_slip(case).axes[0]
        assert axis.get_xlim() == pytest.approx(limits)
        before, after = axis.get_lines()
        assert before.get_xdata()[0] == after.get_xdata()[0] == pytest.approx(begin)
        expected = [float(BASES["kiencke"](jnp.asarray(s), {})) for s in before.get_xdata()[::60]]
        np.testing.assert_allclose(before.get_ydata()[::60], expected, rtol=1e-9, atol=1e-12)
        assert np.isfinite(after.get_ydata()).all()


def test_no_column_varies():
    findings = null()
    points = findings.points[["run", "slip", "adhesion", "before", "after"]].assign(slip=0.02)
    still = findings._replace(points=points)
    assert residual_panels(still) is None
    assert "residuals.png" not in page_markdown(page(still))


def test_on_the_terminal():
    text = printed(two_effects())
    assert max(map(len, text.splitlines())) <= 101
    assert " ".join(text.split()).startswith(verdict(two_effects()))
    for word in ("cross-validation", "57.8 % [49.5, 63.9]", "c4 0.03121", "Warning: The residual"):
        assert word in text
    assert "error after  parameters" not in printed(null())


def test_events_that_were_cut_out_are_shown_in_the_report(tmp_path):
    time = 0.01 * np.arange(20_000)
    slip = 0.002 + 0.1 * np.sin(np.pi * np.clip(time - 90, 0, 6) / 6) ** 2
    table = pd.DataFrame({"time_s": time, "slip_ratio": slip, "adhesion": slip})
    logs = events_of([to_measured("log.csv", table)])
    assert len(logs[0].events.table) == 1
    write_discovery(tmp_path, null(), logs)
    assert (tmp_path / "events.png").is_file()
    assert "](events.png)" in (tmp_path / "report.md").read_text()
    drawn = base64.b64encode((tmp_path / "events.png").read_bytes()).decode()
    assert drawn in (tmp_path / "report.html").read_text()
