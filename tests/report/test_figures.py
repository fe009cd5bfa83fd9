"""What the figures show, read from their lines, bands, labels and limits; data made by hand."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from scipy.stats import norm

from adhesion_jax.report.montecarlo import figures
from experiments.claims import report as claims
from experiments.claims.he2018 import Fit
from experiments.discovery_peers.report import draw_peers


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Draws, and gives the axes that would have been saved."""
    saved = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: saved.append(figure))

    def draw(function, *arguments):
        function(tmp_path / "figure.png", *arguments)
        return saved[-1].axes

    return draw


def lines_of(axis):
    return {line.get_label(): line.get_xydata() for line in axis.get_lines()}


#: Four runs of two blocks by two methods; mu_max is .3 and then .1.
TRUTH = pd.DataFrame({"block": [0, 1], "c1": [0.32, 0.12], "mu_max": [0.3, 0.1], "slip_opt": 0.02})
ERRORS = np.array([-0.02, -0.01, 0.01, 0.04])


def bands(truth, blocks):
    """Medians and bands of the four runs of both methods, from 5 to 95 %."""
    low, median, high = np.quantile(ERRORS, [0.05, 0.5, 0.95])
    return pd.DataFrame(
        [
            {
                "identifier": name,
                "quantity": quantity,
                "block": block,
                "p05": true + shift + low,
                "median": true + shift + median,
                "p95": true + shift + high,
            }
            for name, shift in (("one", 0.0), ("other", 0.005))
            for quantity, of_block in truth.items()
            for block, true in zip(blocks, of_block, strict=True)
        ]
    )


def densities(truth, reach):
    """Those of the four runs of both methods, in 60 bins about the truth of each rail."""
    frames = []
    for rail, true in truth.items():
        for name, shift in (("one", 0.0), ("other", 0.005)):
            lines = true + np.linspace(-reach, reach, 61)
            density = np.histogram(true + ERRORS + shift, lines)[0] / (4 * np.diff(lines))
            columns = {"lower": lines[:-1], "upper": lines[1:], "density": density}
            names = {"scenario": "two rails", "rail": rail, "identifier": name}
            frames.append(pd.DataFrame({**names, **columns}))
    return pd.concat(frames, ignore_index=True)


def test_the_histogram_has_the_density_of_each_method_the_truth_and_the_bound():
    summary = pd.DataFrame(
        {
            "scenario": "two rails",
            "rail": ["dry", "wet"] * 2,
            "identifier": ["one", "one", "other", "other"],
            "quantity": "mu_max",
            "truth": [0.3, 0.1] * 2,
            "crlb": 0.005,
        }
    )
    axes = figures.histogram(summary, densities({"dry": 0.3, "wet": 0.1}, 0.03)).axes
    assert [text.get_text() for text in axes[0].get_yticklabels()] == ["one", "other"]
    for axis, rail, truth in zip(axes, ("dry", "wet"), (0.3, 0.1), strict=True):
        assert axis.get_xlabel() == r"maximum adhesion $\mu_{max}$ (1)"
        *curves, line = axis.get_lines()
        assert line.get_xdata() == pytest.approx([truth, truth])
        # A quarter of the estimates of each method lies in one bin of .001.
        high = 1.1 * 0.25 / 0.001
        assert axis.get_title() == f"{rail} rail\na row is as high as a density of {high:.0f}"
        for place, (steps, curve) in enumerate(zip(axis.patches, curves, strict=True)):
            values, edges, base = steps.get_data()
            density = high * (values - base)
            assert base == -place
            # Three of four estimates lie on the axis, and one beyond is told.
            assert (edges[0], edges[-1]) == pytest.approx((truth - 0.03, truth + 0.03))
            assert np.sum(density * np.diff(edges)) == pytest.approx(0.75)
            mean = np.sum(density * np.diff(edges) * (edges[1:] + edges[:-1]) / 2) / 0.75
            there = np.array([-0.02, -0.01, 0.01]) + 0.005 * place
            assert mean == pytest.approx(truth + there.mean(), abs=np.diff(edges)[0])
            x, normal = curve.get_xdata(), high * (curve.get_ydata() + place)
            assert normal == pytest.approx(norm.pdf(x, truth, 0.005), rel=1e-9, abs=1e-9)
        assert [text.get_text() for text in axis.texts] == ["25 % beyond", "25 % beyond"]


def test_the_histogram_draws_what_has_no_bound_and_no_estimate_on_its_axis():
    names = {"scenario": "one", "rail": "dry", "identifier": "lost", "quantity": "mu_max"}
    summary = pd.DataFrame([{**names, "truth": 0.3}])
    bins = pd.DataFrame({**names, "lower": [0.2, 0.3], "upper": [0.3, 0.4], "density": 0.0})
    for bound in (np.nan, 0.0):
        (axis,) = figures.histogram(summary.assign(crlb=bound), bins).axes
        assert [text.get_text() for text in axis.texts] == ["100 % beyond"]


def test_tracking_shows_the_median_the_band_the_truth_and_the_error_in_per_cent():
    found = bands({name: TRUTH[name] for name in ("c1", "mu_max")}, TRUTH["block"])
    axes = figures.tracking(TRUTH, found).axes
    columns = np.reshape(axes, (3, 2))
    assert [axis.get_title() for axis in columns[0]] == ["one", "other"]
    assert [axis.get_ylabel() for axis in columns[:, 0]] == [
        "$c_1$ (1)",
        r"$\mu_{max}$ (1)",
        r"error of $\mu_{max}$ (%)",
    ]
    assert {axis.get_xlabel() for axis in columns[-1]} == {"block (1)"}
    for column, shift in zip(columns.T, (0.0, 0.005), strict=True):
        lines = lines_of(column[1])
        # Steps from half a block before to half a block after.
        assert lines["truth"].T.tolist() == [[-0.5, 0.5, 0.5, 1.5], [0.3, 0.3, 0.1, 0.1]]
        assert lines["median"][:, 1] == pytest.approx(lines["truth"][:, 1] + shift)
        (band,) = column[1].collections
        heights = band.get_paths()[0].vertices[:, 1]
        low, high = np.quantile(ERRORS, [0.05, 0.95]) + shift
        assert (heights.min(), heights.max()) == pytest.approx((0.1 + low, 0.3 + high))
        error = lines_of(column[2])["median"][:, 1]
        assert error == pytest.approx([100 * shift / 0.3] * 2 + [100 * shift / 0.1] * 2, abs=1e-9)


def test_convergence_shows_medians_with_their_spread_about_the_truth():
    shown = ("c1", "mu_max", "c2", "slip_opt")
    checkpoints = pd.DataFrame(
        [
            {"identifier": name, "quantity": quantity, "truth": 0.3, "crlb": bound}
            for name in ("one", "other")
            for quantity in shown
            for bound in (0.02, 0.01)
        ]
    )

    at_lengths = bands(dict.fromkeys(shown, (0.3, 0.3)), (0, 1))
    axes = figures.convergence(checkpoints, at_lengths, "points seen (1)", [50.0, 100.0]).axes
    assert [axis.get_ylabel() for axis in axes] == [figures.LABELS[name] for name in shown]
    for axis in axes:
        assert axis.get_xlabel() == "points seen (1)"
        assert axis.get_ylim() == pytest.approx((0.3 - 8 * 0.015, 0.3 + 8 * 0.015))
        one, other = axis.containers
        assert (one.get_label(), other.get_label()) == ("one", "other")
        for bars, shift, side in ((one, 0.0, -2.5), (other, 0.005, 2.5)):
            seen, middle = bars.lines[0].get_data()
            assert seen == pytest.approx([50 + side, 100 + side])
            assert middle == pytest.approx([0.3 + shift] * 2)
            segment = bars.lines[2][0].get_segments()[0][:, 1] - 0.3 - shift
            assert segment == pytest.approx(np.quantile(ERRORS, [0.05, 0.95]))
        (truth,) = (line for line in axis.get_lines() if len(set(line.get_ydata())) == 1
                    and line.get_color() == "0.4")  # fmt: skip
        assert truth.get_ydata()[0] == 0.3


@pytest.mark.parametrize("shown", [("a0", "p1", "p2", "mu_max"), ("steepness", "mu_max")])
def test_convergence_draws_parameters_of_any_name_and_what_has_no_bound(shown):
    checkpoints = pd.DataFrame(
        [
            {"identifier": "one", "quantity": quantity, "truth": 0.3, "crlb": bound}
            for quantity in shown
            for bound in ((np.nan, np.nan) if quantity == shown[0] else (np.nan, 0.01))
        ]
    )
    at_lengths = bands(dict.fromkeys(shown, (0.3, 0.3)), (0, 1))
    axes = figures.convergence(checkpoints, at_lengths, "points seen (1)", [50.0, 100.0]).axes
    assert [axis.get_ylabel() for axis in axes] == [figures.LABELS.get(q, q) for q in shown]
    assert np.isfinite(axes[0].get_ylim()).all()
    assert axes[1].get_ylim() == pytest.approx((0.3 - 8 * 0.01, 0.3 + 8 * 0.01))


def test_peers_are_drawn_set_by_set_and_what_is_far_below_nothing_at_the_edge(drawn):
    rows = pd.DataFrame(
        {
            "set": ["a", "b", "c"] * 2,
            "planted": ["patch", "nothing", "lag"] * 2,
            "method": ["discovery"] * 3 + ["trees"] * 3,
            "removed": [0.95, np.nan, 0.5, 0.2, np.nan, -7.0],
        }
    )
    (axis,) = drawn(draw_peers, rows)
    assert [text.get_text() for text in axis.get_yticklabels()] == ["c: lag", "a: patch"]
    assert axis.get_xlim() == pytest.approx((-0.33, 1.08))
    assert axis.get_xlabel().startswith("share of the removable squared error removed")
    assert axis.get_xlabel().endswith("left edge: -.3 or less")
    lines = lines_of(axis)
    assert lines["discovery"][:, 0].tolist() == [0.5, 0.95]
    assert lines["trees"][:, 0].tolist() == [-0.3, 0.2]
    assert np.all(lines["trees"][:, 1] > lines["discovery"][:, 1])


def test_consistency_shows_rmse_with_its_error_and_the_bound_on_logarithmic_axes(drawn):
    names = ("c1", "c2", "c3", "mu_max")
    table = pd.DataFrame(
        [
            {"points": n, "quantity": name, "rmse": 1.1 / n, "rmse_se": 0.1 / n, "crlb": 1 / n}
            for name in names
            for n in (100, 400)
        ]
    )
    fits = {name: Fit(-0.5, 0.01) for name in names}
    for axis, name in zip(drawn(claims.consistency, table, fits), names, strict=True):
        assert axis.get_ylabel() == f"RMSE of {figures.LABELS[name]}"
        assert axis.get_xlabel() == "points in the block (1)"
        assert (axis.get_xscale(), axis.get_yscale()) == ("log", "log")
        assert lines_of(axis)["Cramér-Rao bound"].tolist() == [[100, 0.01], [400, 0.0025]]
        (bars,) = axis.containers
        assert bars.get_label() == "exact optimum, slope -0.500 ± 0.010"
        assert bars.lines[0].get_ydata() == pytest.approx([0.011, 0.00275])
        segment = bars.lines[2][0].get_segments()[0][:, 1]
        assert segment == pytest.approx([0.010, 0.012])


def test_generations_show_the_share_of_runs_that_have_arrived(drawn):
    counts = np.array([[10.0, 20.0], [np.inf, 30.0]])
    never = np.full((2, 2), np.inf)
    panels = {("random", "steady"): {"without": counts, "with": never}}
    (axis,) = drawn(claims.generations, panels, 50, "at the optimum")
    assert axis.get_title() == "random, steady"
    assert axis.get_xlabel() == "generation (1)"
    assert axis.get_ylabel() == "share of runs\nat the optimum (1)"
    assert axis.get_xlim() == (0, 50)
    without, with_ = axis.get_lines()[:2]
    assert without.get_label() == "without: median 25, 25.0 % never"
    assert with_.get_label().endswith("100.0 % never")
    share = without.get_ydata()
    assert [share[k] for k in (9, 10, 19, 20, 29, 30, 50)] == [0, 0.25, 0.25, 0.5, 0.5, 0.75, 0.75]
    assert set(with_.get_ydata()) == {0.0}
    assert to_rgba(without.get_color()) != to_rgba(with_.get_color())
