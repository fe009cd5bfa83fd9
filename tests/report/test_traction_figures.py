"""What is drawn of a traction run."""

from types import SimpleNamespace

import numpy as np

from adhesion_jax.report.traction.panels import KMH, Line, Shown, draw, over_curves
from adhesion_jax.report.traction.systems import lyapunov_panels


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
