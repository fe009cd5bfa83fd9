"""What the figure of a log shows, read from its axes."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from adhesion_jax.data.events import events_of
from adhesion_jax.data.reading import to_measured
from adhesion_jax.report.events import draw_events


def log(count):
    """An hour at 10 Hz and 10 m/s with events every few minutes."""
    time = 0.1 * np.arange(36_000)
    slip = 0.002 + 1e-4 * np.random.default_rng(0).standard_normal(time.size)
    for begin in 60 + np.arange(count) * 3400 / count:
        inside = (time - begin) / 6
        slip += np.where((inside > 0) & (inside < 1), 0.1 * np.sin(np.pi * inside) ** 2, 0.0)
    adhesion = 0.3 * (1 - np.exp(-80 * slip))
    return pd.DataFrame(
        {"time_s": time, "vehicle_speed_mps": 10.0, "slip_ratio": slip, "adhesion": adhesion}
    )


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    def draw(*tables):
        kept = []
        monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: kept.append(figure))
        found = events_of([to_measured("log.csv", table) for table in tables])
        draw_events(tmp_path, found)
        return found[0].events, kept[0].axes

    return draw


def test_every_event_is_shaded_numbered_and_has_its_points(drawn):
    events, axes = drawn(log(5))
    assert len(events.table) == 5
    speed, slip, *panels = axes
    assert len(slip.patches) == len(speed.patches) == 5
    assert [text.get_text() for text in speed.texts] == ["1", "2", "3", "4", "5"]
    shown = [axis for axis in panels if axis.lines]
    for axis, (_, event) in zip(shown, events.table.iterrows(), strict=True):
        assert axis.get_title().startswith(f"{event['run']}: ")
        assert sum(len(line.get_xdata()) for line in axis.lines) == event["rows"]


def test_nothing_is_hidden_by_the_band(drawn):
    table = log(5)
    _, (_, slip, *_) = drawn(table)
    band = slip.collections[0].get_paths()[0].vertices
    assert band[:, 1].max() == pytest.approx(table["slip_ratio"].max(), rel=0.02)
    assert slip.get_xlabel() == "time from the beginning of the log (min)"
    assert slip.get_xlim() == (0, pytest.approx(59.998, abs=0.01))


def test_of_many_events_some_have_panels_spread_over_the_log(drawn):
    events, (speed, _, *panels) = drawn(log(40))
    assert len(events.table) == 40
    shown = [axis.get_title().split(":")[0] for axis in panels if axis.lines]
    assert len(shown) == 12
    assert shown[0] == "1"
    assert shown[-1] == "40"
    places = np.array([text.xy[0] for text in speed.texts])
    assert np.diff(places).min() > 0.02
    assert places.size > 10


def test_a_log_without_a_speed_has_no_panel_of_it(drawn):
    table = log(3)
    velocity = 10 * table["slip_ratio"]
    other = table.drop(columns=["vehicle_speed_mps", "slip_ratio"]).assign(
        slip_velocity_mps=velocity
    )
    _, axes = drawn(other)
    assert axes[0].get_ylabel() == "slip velocity (m/s)"
    assert not any("speed (km/h)" in axis.get_ylabel() for axis in axes)


def test_several_logs_are_drawn_one_after_the_other(drawn):
    later = log(2)
    later["time_s"] += 1e6
    _, (speed, slip, *panels) = drawn(log(3), later)
    assert [text.get_text() for text in speed.texts] == ["1.1", "1.2", "1.3", "2.1", "2.2"]
    assert len(slip.patches) == 5
    assert slip.get_xlabel() == "time from the beginning of the log (h)"
    assert slip.get_xlim() == (0, pytest.approx(2.0, abs=0.001))
    shown = [axis for axis in panels if axis.lines]
    assert [axis.get_title().split(":")[0] for axis in shown] == ["1.1", "1.2", "1.3", "2.1", "2.2"]
