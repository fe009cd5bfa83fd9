"""What is drawn of a traction run."""

from types import SimpleNamespace

import numpy as np
import pandas as pd

from adhesion_jax.report.traction.panels import KMH, Line, Shown, by_method, draw, over_curves
from adhesion_jax.report.traction.systems import lyapunov_panels, uyulan2018_table
from adhesion_jax.traction.systems.uyulan2018 import PRINTED


def test_the_operating_point_is_drawn_in_traction_and_as_far_as_the_curves_go():
    sample = SimpleNamespace(
        counts=np.array([True, True, True, True]),
        direction=np.array([1.0, 1.0, 1.0, -1.0]),
        slip=np.array([[1.0, 3.0], [3.0, 3.0], [5.0, 5.0], [-1.0, -1.0]]),
        adhesion=np.array([[0.1, 0.3], [0.3, 0.3], [0.1, 0.1], [-0.1, -0.1]]),
    )
    run = Shown(None, SimpleNamespace(sample=sample), unit=KMH)
    curve = Line("dry", np.linspace(0.0, 3.6 * 4.0, 10), np.zeros(10))
    panel = over_curves(run, [curve])
    assert panel.x_label == "slip velocity (km/h)"
    track, drawn = panel.lines
    assert drawn is curve
    np.testing.assert_allclose(track.x, [7.2, 10.8, np.nan])
    np.testing.assert_allclose(track.y, [0.2, 0.3, 0.1])


def test_below_a_lyapunov_function_stands_how_fast_it_changes(tmp_path):
    falling = Line("sign", np.array([0.0, 0.5, 1.0]), np.array([3.0, 1.0, 2.0]))
    function, rate = lyapunov_panels({"dry-low": [falling]})
    assert function.lines == [falling]
    np.testing.assert_allclose(rate.lines[0].x, [0.5, 1.0])
    np.testing.assert_allclose(rate.lines[0].y, [-4.0, 2.0])
    assert (function.linear, rate.linear) == (None, 1e-6)
    draw(tmp_path / "both.png", [function, rate._replace(ratio=True)])
    assert (tmp_path / "both.png").stat().st_size > 10_000


def test_methods_that_are_not_of_the_paper_are_all_drawn():
    def drawn(cases, *methods):
        runs = [Shown(SimpleNamespace(scenario=rail, method=name), None) for rail, name in cases]
        found = by_method(runs, *methods, title="scenario")
        return [(one.case.scenario, one.case.method, one.title) for one in found]

    several = [("dry", "a"), ("dry", "b"), ("wet", "a"), ("wet", "b")]
    assert drawn(several, "b") == [("dry", "b", "dry"), ("wet", "b", "wet")]
    assert drawn(several, "theirs") == [("dry", "a", "a"), ("dry", "b", "b")]
    assert drawn(several[::2], "theirs") == [("dry", "a", "dry"), ("wet", "a", "wet")]


def test_the_table_of_uyulan_has_both_figures_of_one_method_in_a_row():
    def table(*methods):
        rows = [
            {"scenario": "-".join(names), "method": name, "tracking_rms": x, "estimation_rms": y}
            for names in PRINTED
            for name, x, y in methods
        ]
        return uyulan2018_table(pd.DataFrame(rows).assign(noise="none", segment="all"))

    papers = ["paper_tracking_rms", "paper_estimation_rms"]
    found = table(("true optimum", 1.0, 0.0), ("as printed", 2.0, 3.0))
    assert [*found] == ["scenario", "tracking_rms", "estimation_rms", *papers]
    assert found.iloc[0].tolist() == ["dry-low", 1.0, 3.0, 0.1874, 0.1043]
    found = table(("controller a", 1.0, 4.0), ("controller b", 2.0, 5.0))
    assert [*found] == ["scenario", "method", "tracking_rms", "estimation_rms", *papers]
    assert found.iloc[1].tolist() == ["dry-low", "controller b", 2.0, 5.0, 0.1874, 0.1043]
    assert len(found) == 2 * len(PRINTED)
