"""What is drawn of a traction run."""

from types import SimpleNamespace

import numpy as np

from adhesion_jax.report.traction.panels import Line
from adhesion_jax.report.traction.runs import KMH, Shown, over_curves


def test_the_operating_point_is_drawn_in_traction_and_as_far_as_the_curves_go():
    sample = SimpleNamespace(
        counts=np.array([True, True, True, True]),
        direction=np.array([1.0, 1.0, 1.0, -1.0]),
        slip=np.array([[1.0, 3.0], [3.0, 3.0], [5.0, 5.0], [-1.0, -1.0]]),
        adhesion=np.array([[0.1, 0.3], [0.3, 0.3], [0.1, 0.1], [-0.1, -0.1]]),
    )
    run = Shown(None, SimpleNamespace(sample=sample))
    curve = Line("dry", np.linspace(0.0, 3.6 * 4.0, 10), np.zeros(10))
    panel = over_curves(run, "title", [curve], KMH)
    assert panel.x_label == "slip velocity (km/h)"
    track, drawn = panel.lines
    assert drawn is curve
    np.testing.assert_allclose(track.x, [7.2, 10.8, np.nan])
    np.testing.assert_allclose(track.y, [0.2, 0.3, 0.1])
