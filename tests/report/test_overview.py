"""Which method when: the words follow the numbers, and the page has them all."""

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.campaign.job import SEVERAL
from adhesion_jax.library.montecarlo import montecarlo
from adhesion_jax.report.montecarlo.overview import advice, figure, page

STREAMS = ("stream", "drift", "wave")


def table_of(ratios, coverages, failures=None):
    """An overview of streams and of single, from numbers by method."""
    rows = []
    for name, own in ratios.items():
        for scenario, ratio, coverage in zip(STREAMS, own, coverages[name], strict=True):
            rows.append(
                {
                    "scenario": scenario,
                    "kind": "stream",
                    "identifier": name,
                    "rmse": 0.001 * ratio,
                    "rmse_over_crlb": ratio,
                    "rmse_over_crlb_se": 0.02,
                    "cut_off": False,
                    "coverage95": coverage,
                    "coverage95_se": 0.01,
                    "failure_share": (failures or {}).get(name, 0.0),
                    "delay": np.nan,
                    "false_resets_per_1000": 0.0,
                    "lag": np.nan,
                    "microseconds": 1.0 + len(rows),
                    "bytes": 100,
                }
            )
    blocks = {**rows[0], "scenario": "single", "kind": "blocks", "identifier": "exact"}
    return pd.DataFrame([*rows, {**blocks, "rmse_over_crlb": 1.01}])


def test_the_advice_is_that_of_the_numbers():
    ratios = {"steady": (1.0, 30.0, 20.0), "tracker": (1.5, 2.0, 3.0), "wide": (2.0, 2.5, 3.5)}
    coverages = {
        "steady": (0.95, 0.0, 0.1),
        "tracker": (0.95, 0.8, 0.7),
        "wide": (0.96, 0.94, 0.92),
    }
    controller, log, stream, blocks, far = advice(table_of(ratios, coverages))
    assert controller.startswith("For a controller take tracker: over 3 streams")
    assert f"{(1.5 * 2 * 3) ** (1 / 3):.2f} times the bound" in controller
    assert "3 times at worst (wave)" in controller
    assert "The next one is wide" in controller
    assert log.startswith("For a log, where intervals are to be believed, take wide: on 3 of 3")
    assert "in 92 % at worst (wave)" in log
    assert "on streams take steady" in stream
    assert "on blocks take exact" in blocks
    assert far == "None of these methods comes within twice the bound on wave."
    # Other numbers, other words; who fails is not advised.
    turned = {"tracker": (1.5, 20.0, 30.0), "steady": (1.0, 2.0, 2.0), "wide": ratios["wide"]}
    words = advice(table_of(turned, coverages))
    assert words[0].startswith("For a controller take steady")
    assert not any("None of these" in word for word in words)
    words = advice(table_of(turned, coverages, {"steady": 0.02}))
    assert words[0].startswith("For a controller take wide")


def test_what_a_box_cuts_off_is_shown_in_brackets_and_not_advised():
    table = table_of({"one": (1.0, 1.2, 1.5)}, {"one": (0.95, 0.95, 0.95)})
    cut = {**table.iloc[-1], "scenario": "coloured", "rmse_over_crlb": 0.7, "cut_off": True}
    boxed = {**table.iloc[-1], "identifier": "boxed", "rmse_over_crlb": 0.6, "cut_off": True}
    both = pd.concat([table, pd.DataFrame([cut, boxed])], ignore_index=True)
    assert advice(both) == advice(table)
    texts = [text.get_text() for text in figure(both).axes[0].texts]
    assert sorted(texts) == ["(0.6)", "(0.7)", "1", "1.01", "1.2", "1.5"]


def test_a_stream_that_few_methods_take_decides_nothing():
    ratios = {"one": (1.0, 1.2, 1.5), "two": (1.1, 1.3, 1.6), "filter": (2.0, 2.0, 2.0)}
    table = table_of(ratios, dict.fromkeys(ratios, (0.95, 0.95, 0.95)))
    own = {**table[table["identifier"] == "filter"].iloc[0], "scenario": "stream-slope"}
    words = advice(pd.concat([table, pd.DataFrame([own])], ignore_index=True))
    assert words[0].startswith("For a controller take one: over 3 streams")


def test_intervals_that_none_can_give_are_named():
    ratios, coverages = {"one": (1.0, 1.2, 1.5)}, {"one": (0.95, 0.5, 0.89)}
    said = advice(table_of(ratios, coverages))[-1]
    assert said.endswith("hold the truth in 90 % of the runs on drift and wave.")


def test_the_page_has_the_words_the_picture_and_every_row():
    table = table_of({"one": (1.0, 1.2, 1.5)}, {"one": (0.95, 0.5, 0.89)})
    made = page(table, 400)
    assert made.verdict == advice(table)[0]
    assert list(made.sections[0].blocks[0].texts) == advice(table)[1:]
    assert made.sections[1].blocks[1].file == "overview.png"
    assert len(made.sections[2].blocks[0].rows) == len(table)
    drawn = figure(table)
    first = drawn.axes[0]
    assert [label.get_text() for label in first.get_yticklabels()] == ["one", "exact"]
    assert sorted(text.get_text() for text in first.texts) == ["1", "1.01", "1.2", "1.5"]


@pytest.mark.thorough
def test_all_scenarios_make_one_page(monkeypatch, tmp_path):
    monkeypatch.setitem(SEVERAL, "all", ("single", "drift"))
    found = montecarlo("all", ("riv", "ml-exact"), runs=8, points=200, out=tmp_path)
    table = found.tables["overview"]
    assert list(zip(table["scenario"], table["identifier"], strict=True)) == [
        ("single", "ml-exact"),
        ("drift", "riv"),
    ]
    assert {path.name for path in tmp_path.iterdir()} >= {"overview.csv", "overview.png"}
    assert "For a controller take riv" in (tmp_path / "report.html").read_text()
    steady = found.tables["steady"]
    own = steady[(steady["scenario"] == "drift") & (steady["quantity"] == "mu_max")].iloc[0]
    row = table.iloc[1]
    assert row["rmse_over_crlb"] == pytest.approx(own["rmse"] / own["crlb"])
    assert row["coverage95"] == pytest.approx(own["coverage95"])
    assert row["microseconds"] == pytest.approx(1e5 * own["seconds_per_identification"])
    assert row["lag"] > 0  # it keeps what was before
