"""The figure of a followed log shows what was followed, where it was."""

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.identifiers import Status
from adhesion_jax.measured.following import Followed
from adhesion_jax.measured.log import Log
from adhesion_jax.report.track.figure import MOST_EVENTS, track_figure
from adhesion_jax.report.track.words import checkpoint_rows, printed_summary, summary_rows


def a_log(events=0, timed=True, samples=6000):
    time = 500.0 + 0.1 * np.arange(samples)
    slip = np.full(samples, 0.002)
    spans = []
    for number in range(events):
        begin = 100 + 700 * number
        slip[begin : begin + 50] = 0.05 + 0.01 * ((3 * number) % 8)
        spans.append((time[begin], time[begin + 49]))
    adhesion = 0.3 * slip / (slip + 0.01)
    used = np.flatnonzero(slip > 0.01) if events else np.arange(samples)
    return Log(
        "the log",
        slip,
        adhesion,
        time if timed else None,
        10 + np.sin(time / 20),
        used,
        np.concatenate([[True], np.diff(used) > 1]),
        np.array(spans).reshape(-1, 2),
        False,
        ("The samples are followed.",),
    )


def a_method(log, resets=(), untrusted=slice(0), bare=slice(0)):
    rows = log.used[:: max(1, log.used.size // 50)]
    status = np.full(rows.size, Status.TRUSTED.value)
    status[untrusted] = Status.NO_PEAK.value
    at_least = np.zeros(rows.size, dtype=bool)
    at_least[bare] = True
    table = pd.DataFrame(
        {
            "sample": rows,
            "mu_max": 0.3,
            "mu_max_se": 0.01,
            "slip_opt": 0.05,
            "slip_opt_se": 0.01,
            "status": status,
            "reset": np.isin(np.arange(rows.size), resets),
            "resets": 0,
            "skipped": 0,
            "at_least": at_least,
            "reached": 0.21,
        }
    )
    return Followed(table, len(resets), 0, int(np.sum(status == 0)), 0.0, 1.0, 1e-6)


def marks(axes):
    return [line.get_xdata() for line in axes.lines if line.get_marker() == "|"]


@pytest.mark.parametrize(
    ("timed", "unit"), [(True, "time from the beginning of the log (min)"), (False, "sample")]
)
def test_resets_and_status_stand_where_they_were(timed, unit):
    log = a_log(timed=timed, samples=7000)
    one, other = a_method(log, (10, 30), slice(5, 15)), a_method(log)
    figure = track_figure("a log", log, {"one": one, "other": other})
    estimates, status, slip, speed = figure.axes
    assert speed.get_xlabel() == unit
    assert slip.get_ylabel() == "slip (1)"
    assert [label.get_text() for label in status.get_yticklabels()] == ["one", "other"]
    at = one.estimates["sample"].to_numpy()
    place = (log.time - 500) / 60 if timed else 1.0 + np.arange(log.slip.size)
    np.testing.assert_allclose(marks(status)[0], place[at[[10, 30]]])
    assert marks(status)[1].size == 0
    # The strip of a method that is not trusted begins and ends with that status.
    hatched = next(one for one in status.collections if one.get_hatch())
    ends = hatched.get_datalim(status.transData).intervalx
    np.testing.assert_allclose(ends, place[[at[5], at[15]]])
    # Where it is not trusted it has no line and no band.
    line = next(line for line in estimates.lines if line.get_linewidth() == 1.7)
    missing = np.isnan(line.get_ydata())
    assert np.all((line.get_xdata()[missing] >= ends[0]) & (line.get_xdata()[missing] <= ends[1]))
    assert missing.sum() == 20


def test_the_events_of_the_largest_slip_have_panels():
    log = a_log(events=8)
    figure = track_figure("a log", log, {"one": a_method(log)})
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    # Tops are .05, .08, .11, .06, .09, .12, .07 and .10: all but events 1 and 4 are shown.
    shown = [title for title in titles if title.startswith("slip event")]
    assert shown == [f"slip event {number}" for number in (2, 3, 5, 6, 7, 8)]
    assert len(shown) == MOST_EVENTS
    begins = log.events[[1, 2, 4, 5, 6, 7], 0]
    slips = [axes for axes in figure.axes if axes.get_xlabel() == "time in the event (s)"]
    assert len(slips) == len(begins)
    for axes, begin in zip(slips, begins, strict=True):
        used = next(line for line in axes.lines if line.get_markersize() == 3.0)
        top = log.slip[round((begin - 500) / 0.1) + 10]
        np.testing.assert_allclose(used.get_ydata(), top)


def test_nothing_of_a_long_log_is_hidden():
    log = a_log()
    log.adhesion[1234] = 0.29
    figure = track_figure("a log", log, {"one": a_method(log)})
    envelope = figure.axes[0].collections[0]
    high = envelope.get_datalim(figure.axes[0].transData).y1
    assert high == pytest.approx(0.29)


def test_where_adhesion_does_not_fall_the_adhesion_reached_is_drawn_and_told():
    log = a_log()
    some = {"one": a_method(log, bare=slice(20, 30)), "two": a_method(log, bare=slice(30, None))}
    figure = track_figure("a log", log, some)
    estimates = figure.axes[0]
    place = log.time - 500  # s
    at = some["one"].estimates["sample"].to_numpy()
    line = next(line for line in estimates.lines if line.get_marker() == "^")
    drawn = np.isfinite(line.get_ydata())
    assert set(line.get_ydata()[drawn]) == {0.21}
    assert line.get_xdata()[drawn].min() == place[at[20]]
    assert line.get_xdata()[drawn].max() == place[at[30]]
    whole = next(line for line in estimates.lines if line.get_linewidth() == 1.7)
    np.testing.assert_array_equal(np.isnan(whole.get_ydata()), drawn)
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "at least: adhesion does not fall" in legend
    table = checkpoint_rows(log, some)
    assert list(np.flatnonzero(table["at_least"][:50])) == list(range(20, 30))
    bare = table[table["at_least"]]
    assert set(bare["mu_max"]) == {0.21}
    assert bare[["mu_max_lo", "mu_max_hi", "slip_opt"]].isna().all(axis=None)
    printed = printed_summary(summary_rows(log, some)).splitlines()
    assert "0.300 ± 0.010" in printed[1]
    assert "at least 0.210" in printed[2]
    assert "0.050" not in printed[2]


def test_where_too_few_samples_show_an_adhesion_none_is_told():
    log = a_log()
    one = a_method(log, bare=slice(0, None))
    some = {"one": one._replace(estimates=one.estimates.assign(reached=0.0))}
    assert checkpoint_rows(log, some)["mu_max"].isna().all()
    summary = summary_rows(log, some)
    assert "unknown" in printed_summary(summary)
    assert "0.000" not in printed_summary(summary)


def test_the_table_and_the_summary_hold_the_estimates():
    log = a_log()
    one = a_method(log, (10,), slice(0, 5))
    table = checkpoint_rows(log, {"one": one})
    np.testing.assert_allclose(table["time_s"], log.time[one.estimates["sample"]])
    np.testing.assert_array_equal(table["sample"], one.estimates["sample"] + 1)
    np.testing.assert_allclose(table["mu_max_hi"] - table["mu_max_lo"], 2 * 1.96 * 0.01)
    assert list(table["status"][:6]) == ["NO_PEAK"] * 5 + ["TRUSTED"]
    row = summary_rows(log, {"one": one}).iloc[0]
    assert (row["resets"], row["samples"], row["status"]) == (1, 6000, "TRUSTED")
    assert row["ns_per_sample"] == pytest.approx(1000.0)
