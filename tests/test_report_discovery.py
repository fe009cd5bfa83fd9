"""Reports of a discovery: what they say, that they say it alike, and that nothing breaks them."""

import csv
import json
from html.parser import HTMLParser

import numpy as np
import pytest
from discovery_examples import NASTY, nasty, null, two_effects, unexplained
from matplotlib.image import imread

from adhesion_jax.discovery.findings import Interval
from adhesion_jax.discovery.law import load_law
from adhesion_jax.files import staged
from adhesion_jax.report.discovery import (
    DISCOVERY_FILES,
    printed,
    report_json,
    verdict,
    write_discovery,
)
from adhesion_jax.report.discovery_figures import adhesion_over_slip
from adhesion_jax.report.discovery_markdown import discovery_markdown
from adhesion_jax.report.discovery_residuals import residual_panels
from adhesion_jax.report.discovery_tables import residual_columns
from adhesion_jax.report.discovery_words import (
    error,
    error_in_brackets,
    humanised,
    in_brackets,
    p_value,
    percent_in_brackets,
    plus_minus,
)

EXAMPLES = {"null": null, "two": two_effects, "unexplained": unexplained, "nasty": nasty}
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
    left_out = {"two": set(), "null": {"predictions.csv", "dependence.png"}}
    assert set(DISCOVERY_FILES) - names == left_out.get(name, {"predictions.csv"})


@pytest.mark.parametrize("name", EXAMPLES)
def test_json_is_plain_and_keeps_its_contract(written, name):
    findings = EXAMPLES[name]()
    report = report_json(findings)
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert json.loads((written[name] / "report.json").read_text()) == report
    assert list(report) == ["base", "noise_floor", "rmse", "effects", "unexplained", "warnings"]
    assert list(report["rmse"]) == ["train", "test"] if findings.test else ["train"]
    assert all(list(pair) == ["before", "after"] for pair in report["rmse"].values())
    for effect in report["effects"]:
        keys = "name candidates covariates parameters p_adjusted rmse_after"
        assert list(effect) == keys.split()
        assert effect["candidates"][0] == effect["name"]
        for parameter in effect["parameters"].values():
            assert list(parameter) == ["value", "low", "high", "unit"]
    for axis in report["unexplained"]:
        assert list(axis) == ["axis", "p_adjusted", "rmse_after"]


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
    assert report_json(unexplained())["unexplained"] == [
        {"axis": "covariate:relative_humidity_pct", "p_adjusted": 0.0031, "rmse_after": 0.01044}
    ]
    assert report_json(nasty())["effects"][0]["covariates"] == [NASTY]


def test_a_class_that_leaves_its_name_out_is_reported_with_it():
    findings = two_effects()
    others = findings.effects[1]._replace(candidates=("falling_friction",))
    report = report_json(findings._replace(effects=(others,)))
    assert report["effects"][0]["candidates"] == ["slip_speed", "falling_friction"]


def test_verdict_of_effects():
    assert verdict(two_effects()) == (
        "What burckhardt lacks here: humidity (adjusted p = 0.0011); exponential loss with slip "
        "velocity (adjusted p = 0.0023; the data cannot tell exponential loss with slip velocity "
        "from falling friction or contact heating). On runs not used for fitting (test set, 8 "
        "runs) the error falls from 0.01588 to 0.01031 [0.00972, 0.01104], which removes 57.8 % "
        "[49.5, 63.9] of the squared error; the noise floor is 0.01002."
    )


def test_verdict_of_nothing():
    assert verdict(null()) == (
        "Nothing that these data could show is missing from burckhardt (the strongest of 2 "
        "candidates, humidity, has adjusted p = 0.17). Its error on runs not used for fitting "
        "(cross-validation, 24 runs) is 0.01012 [0.00942, 0.01095], and the noise floor is 0.01002."
    )
    assert verdict(null()._replace(ranking=())).startswith(
        "Nothing that these data could show is missing from burckhardt. Its error"
    )


def test_verdict_says_that_what_was_significant_did_not_hold():
    ranking = tuple(row._replace(p_adjusted=0.0005) for row in null().ranking)
    assert "has adjusted p = 0.0005, but did not hold: see the ranking). Its error" in verdict(
        null()._replace(ranking=ranking)
    )


def test_verdict_of_structure_without_a_cause():
    assert verdict(unexplained()) == (
        "No known cause is found to be missing. Unexplained structure against "
        "relative_humidity_pct (adjusted p = 0.0031); a non-parametric correction lowers the "
        "error on runs not used for fitting (cross-validation, 24 runs) from 0.01341 to 0.01044 "
        "[0.00984, 0.01118], at a noise floor of 0.01002; no physical cause is claimed."
    )


def test_a_correction_that_helps_nothing_unseen_is_not_praised():
    findings = two_effects()
    worse = findings.test._replace(after=Interval(0.017, 0.016, 0.018))
    assert "the error does not fall: from" in verdict(findings._replace(test=worse))


@pytest.mark.parametrize("name", EXAMPLES)
def test_both_pages_tell_every_number(written, name):
    findings = EXAMPLES[name]()
    told = [error(findings.noise_floor), verdict(findings)]
    told += [f"{value:.4g}" for value in findings.noise.values()]
    for errors in (findings.train, findings.validation, findings.test):
        if errors is not None:
            told += [error_in_brackets(errors.before), error_in_brackets(errors.after)]
            told += [percent_in_brackets(errors.removed), str(errors.runs)]
    for effect in (*findings.effects, *findings.unexplained):
        told += [p_value(effect.p_adjusted), error(effect.rmse_after)]
        told += [" ".join(effect.sentence.split()), *effect.units.values()]
        told += [in_brackets(interval) for interval in effect.parameters.values()]
        told += [humanised(name) for name in effect.candidates if effect in findings.effects]
    for row in findings.base_parameters.to_dict("records"):
        told += [plus_minus(row[when], row[f"{when}_se"]) for when in ("before", "after")]
    for row in findings.ranking:
        told += [humanised(row.name), f"{row.z:.2f}", plus_minus(row.gain, row.gain_se)]
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
    assert "http" not in html
    assert "url(" not in html


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


def test_braking_one_slip_and_another_base_curve_are_drawn():
    findings = two_effects()
    points = findings.points
    braking = points.assign(slip=-points["slip"], adhesion=-points["adhesion"])
    other = findings.base_parameters.assign(parameter=["a", "b", "c"])
    for case, limits, lines in (
        (findings._replace(points=braking), (-0.208, 0.0), 301),
        (findings._replace(points=points.assign(slip=0.02)), (0.0, 0.0208), 301),
        (findings._replace(points=points.assign(slip=0.0)), (0.0, 1.0), 301),
        (findings._replace(base_parameters=other), (0.0, 0.208), len(points)),
    ):
        axis = adhesion_over_slip(case).axes[0]
        assert axis.get_xlim() == pytest.approx(limits)
        before, after = axis.get_lines()
        assert len(before.get_xdata()) == lines
        assert np.isfinite(after.get_ydata()).all()


def test_no_column_varies():
    findings = null()
    points = findings.points[["run", "slip", "adhesion", "before", "after"]].assign(slip=0.02)
    still = findings._replace(points=points)
    assert residual_panels(still) is None
    assert "residuals.png" not in discovery_markdown(still)


def test_on_the_terminal():
    text = printed(two_effects())
    assert max(map(len, text.splitlines())) <= 101
    assert " ".join(text.split()).startswith(verdict(two_effects()))
    for word in ("cross-validation", "57.8 % [49.5, 63.9]", "c4 0.03121", "Warning: The residual"):
        assert word in text
    assert "error after  parameters" not in printed(null())
