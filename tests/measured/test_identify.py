import re
import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.image import imread
from scipy.optimize import least_squares

import adhesion_jax as aj
from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.identify import main
from adhesion_jax.command_line.reading import WANTED
from adhesion_jax.curves import CURVES, physical_box
from adhesion_jax.curves.bent import FUNCTIONS
from adhesion_jax.data import SHIPPED, read_measured, to_record
from adhesion_jax.effects.saved import load_law
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import Status
from adhesion_jax.inference.law import FittedLaw, Span, peak_of
from adhesion_jax.inference.rows import arranged
from adhesion_jax.inference.start import least_squares as start_of
from adhesion_jax.inference.start import parameters_at
from adhesion_jax.measured.answer import fit_curves, log_densities
from adhesion_jax.measured.residual import residual_structure
from adhesion_jax.records import Record
from adhesion_jax.report.measured.words import reasons

SPEED = 10.0
FILES = {"curves.csv", "parameters.csv", "curves.png", "law.json", "metadata.json", "report.html"}
FILES |= {"verdict.txt"}

#: The curves written afresh, from their sources' equations; slip positive, speed 10 m/s.
FORMULAS = {
    "burckhardt": lambda s, c1, c2, c3: c1 * (1 - np.exp(-c2 * s)) - c3 * s,
    "kiencke": lambda s, a0, p1, p2: a0 * s / (1 + p1 * s + p2 * s**2),
    "polach": lambda s, mu0, stiffness: polach(s, mu0, stiffness, 1.0),
    "polach-falling": lambda s, mu0, a, b, stiffness, k_s: polach(
        s, mu0 * ((1 - a) * np.exp(-b * SPEED * s) + a), stiffness, k_s
    ),
    "exponential": lambda s, a, b, c: c * (np.exp(-a * s) - np.exp(-b * s)),
    "magic-formula": lambda s, b, c, d, e: (
        d * np.sin(c * np.arctan(b * s - e * (b * s - np.arctan(b * s))))
    ),
}


def polach(slip, friction, stiffness, k_s):
    e = np.pi * stiffness * slip / (4 * friction)
    return 2 * friction / np.pi * (e / (1 + e**2) + np.arctan(k_s * e))


def record_of(slip, adhesion):
    speed = jnp.full(slip.size, SPEED)
    mask = jnp.ones(slip.size, dtype=bool)
    return Record(
        jnp.asarray(slip), jnp.asarray(adhesion), mask, mask, {"vehicle_speed_mps": speed}
    )


def fit_all(curves, record, slip_is_velocity=False, run=None):
    run = np.zeros(record.slip.size, dtype=int) if run is None else run
    return fit_curves(curves, record, run, slip_is_velocity).curves


def fit_measured(curve, record, slip_is_velocity=False, run=None):
    return fit_all({"one": curve}, record, slip_is_velocity, run)["one"]


def drawn(curve, slip, sigma, seed):
    record = record_of(slip, np.zeros_like(slip))
    noise = sigma * np.random.default_rng(seed).standard_normal(slip.size)
    return record._replace(adhesion=curve(record.slip, record.conditions) + noise)


every_curve = pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=pytest.mark.long if "falling" in one else ()) for one in CURVES],
)


@pytest.fixture(scope="module")
def eurosprinter():
    return to_record(read_measured(SHIPPED["eurosprinter"].path))


@pytest.fixture(scope="module")
def fits(eurosprinter):
    return fit_all(CURVES, eurosprinter, False)


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """The command on the shipped set, into a folder that holds other files."""
    out = tmp_path_factory.mktemp("identify")
    (out / "notes.txt").write_text("mine")
    (out / "curves.csv").write_text("old")
    result = CliRunner().invoke(main, ["eurosprinter", "--out", str(out)], catch_exceptions=False)
    assert result.exit_code == 0
    return out, result.stdout


@pytest.mark.thorough
def test_the_measured_locomotive(told):
    out, output = told
    table = pd.read_csv(out / "curves.csv").set_index("curve")
    assert list(table.index) == list(CURVES)
    # Two independent analyses of these points have .0254 for Burckhardt's and .0242 for Polach's.
    assert table["rms"].between(0.0236, 0.0257).all()
    assert table["status"].str.startswith(("TRUSTED", "ON_BOX")).all()
    # Coulomb's friction cannot fall: the points depart from it.
    assert table["misfit"]["polach"] > 0.05
    # Engel et al. report adhesion of .3 and more at 2 % creep.
    assert table["mu_max"].between(0.29, 0.32).all()
    assert table["slip_opt"].between(0.015, 0.035).all()
    assert table["weight"].sum() == pytest.approx(1)
    assert ((table["mu_max_lo"] < table["mu_max"]) & (table["mu_max"] < table["mu_max_hi"])).all()
    for name in table.index:
        assert name in output


def test_the_files_and_their_neighbours(told, fits):
    out, _ = told
    assert {path.name for path in out.iterdir()} == FILES | {"notes.txt"}
    assert (out / "notes.txt").read_text() == "mine"
    table = pd.read_csv(out / "curves.csv")
    first = "curve rms slip_opt slip_opt_se mu_max mu_max_lo mu_max_hi status weight"
    assert list(table.columns[:9]) == first.split()
    assert table.notna().all(axis=None)
    parameters = pd.read_csv(out / "parameters.csv").set_index("curve")
    assert list(parameters) == ["parameter", "value", "se", "unit", "meaning"]
    for name, curve in CURVES.items():
        own = parameters.loc[name]
        assert tuple(own["parameter"]) == curve.free
        np.testing.assert_array_equal(own["se"].notna(), ~fits[name].held)
    added = "weight log_density sigma autocorrelation run_scatter slow_level misfit degrees"
    assert list(table.columns[-8:]) == added.split()
    image = imread(out / "curves.png")
    assert image.shape[0] > 800
    assert image.std() > 0.05


def test_the_verdict(told):
    out, output = told
    verdict = " ".join((out / "verdict.txt").read_text().split())
    assert verdict in " ".join(output.split())
    for part in (
        "The weights in the answer by all curves, after the same density: polach-falling 0.6",
        "polach-falling predicts best the points that are left out of its fit",
        "by all curves together, adhesion 0.30",
        "The points follow polach-falling itself: no departure from it is seen.",
        "The intervals rest on the scatter of the points about the curve",
        "The slip is taken as exact: without the column time_s",
        "lies within the measured slips",
        "neighbouring points scatter by 0.0244",
        "no structure is left",
        "Elektrische Bahnen 96 (1998) 201-209",
        "eve70a/CONTACT (Apache-2.0)",
    ):
        assert part in verdict


def test_the_table_holds_full_precision(told, fits):
    table = pd.read_csv(told[0] / "parameters.csv").set_index("curve")
    for name, fit in fits.items():
        np.testing.assert_array_equal(table.loc[name, "value"], fit.parameters)


@every_curve
def test_no_start_of_an_independent_solver_finds_better(name, eurosprinter):
    slip, adhesion = np.asarray(eurosprinter.slip), np.asarray(eurosprinter.adhesion)
    lower, upper = (np.asarray(bound) for bound in physical_box(CURVES[name]))
    logarithmic = lower > 0
    rng = np.random.default_rng(1)

    def to_parameters(x):
        return np.where(logarithmic, np.exp(np.where(logarithmic, x, 0)), x)

    low = np.where(logarithmic, np.log(np.where(logarithmic, lower, 1)), lower)
    high = np.where(logarithmic, np.log(np.where(logarithmic, upper, 1)), upper)

    def residual(x):
        with np.errstate(all="ignore"):  # the box has corners where a curve has no finite value
            model = FORMULAS[name](slip, *to_parameters(x))
        return np.nan_to_num(model, nan=1e3, posinf=1e3, neginf=-1e3) - adhesion

    found = [
        least_squares(residual, rng.uniform(low, high), bounds=(low, high), xtol=1e-12, ftol=1e-12)
        for _ in range(25)
    ]
    best = min(found, key=lambda solution: solution.cost)
    parameters = parameters_at(CURVES[name], start_of(CURVES[name], eurosprinter))
    squares = float(np.sum((FORMULAS[name](slip, *parameters) - adhesion) ** 2))
    assert squares <= 2 * best.cost * (1 + 1e-9)
    assert squares == pytest.approx(2 * best.cost, rel=1e-6)
    if name != "polach-falling":  # whose parameters these points do not settle
        np.testing.assert_allclose(parameters, to_parameters(best.x), rtol=1e-3)


@every_curve
def test_known_parameters_are_recovered(name):
    """From both braking and traction, each within four standard errors; peak and level as well."""
    truth = CURVES[name]
    if name == "polach-falling":
        truth = replace(truth, b=1.0)  # over a decay length, or a and b cannot be told apart
    slip = np.linspace(0.0015, 0.4, 163) * np.where(np.arange(163) % 3 == 0, -1, 1)
    fit = fit_measured(truth, drawn(truth, slip, 0.002, seed=3), False)
    expected = np.array([getattr(truth, parameter) for parameter in truth.free])
    if name != "polach":  # which has no peak, but bends within the noise
        assert fit.status is Status.TRUSTED
    assert np.all(np.abs(fit.parameters - expected) < 4 * fit.standard_errors)
    assert fit.rms == pytest.approx(0.002, rel=0.25)
    peak = jax.jit(lambda: truth.peak({"vehicle_speed_mps": SPEED}))()
    assert abs(fit.peak.adhesion - peak.adhesion) < 4 * fit.mu_max_se
    if name != "polach":
        assert abs(fit.peak.slip - peak.slip) < 4 * fit.slip_opt_se


def test_a_parameter_on_its_bound_is_held_and_the_reason_is_given():
    """The other estimates and errors are those of the curve with that parameter known."""
    rising = replace(CURVES["burckhardt"], c3=-0.2)
    record = drawn(rising, np.linspace(0.002, 0.2, 163), 0.005, seed=1)
    fit = fit_measured(CURVES["burckhardt"], record, False)
    known = fit_measured(replace(CURVES["burckhardt"], c3=0.0, free=("c1", "c2")), record, False)
    assert fit.parameters[2] == 0
    assert list(fit.on_bound) == [False, False, True]
    assert np.isnan(fit.standard_errors[2])
    np.testing.assert_allclose(fit.parameters[:2], known.parameters, rtol=1e-4)
    np.testing.assert_allclose(fit.standard_errors[:2], known.standard_errors, rtol=1e-3)
    assert fit.degrees == pytest.approx(known.degrees, rel=1e-2)
    said = " ".join(reasons(fit))
    assert "c3 lies on its bound 0: it has no standard error" in said
    assert "no peak between slip 0 and 1" in said


@pytest.mark.long
def test_points_at_two_slips_leave_every_fit_a_number_and_its_two_levels():
    """The parameters are not determined; the adhesion at the two slips is."""
    slip = np.repeat([0.02, 0.05], 20)
    adhesion = np.where(slip < 0.03, 0.2, 0.3) + 0.005 * np.random.default_rng(5).normal(size=40)
    for fit in fit_all(CURVES, record_of(slip, adhesion)).values():
        assert np.all(np.isfinite(fit.parameters))
        assert np.all(np.isfinite(fit.left_out))
        for at in (0.02, 0.05):
            level = fit.law.at(np.array([at])).adhesion[0]
            assert level == pytest.approx(np.mean(adhesion[slip == at]), abs=0.005)


@pytest.mark.parametrize("c2", [20.0, 36.6, 100.0, 1000.0])
@pytest.mark.parametrize(("c3", "falls"), [(0.0, False), (1e-16, False), (1e-6, True), (0.1, True)])
def test_a_curve_that_becomes_level_has_no_peak_and_one_that_falls_a_little_has(c2, c3, falls):
    """Burckhardt's curve is largest at ln(c1 c2/c3)/c2; with c3 = 0 it rises without end."""
    c1 = 0.324
    parameters = np.append([c1, c2, c3], np.zeros(FUNCTIONS))
    law = FittedLaw(CURVES["burckhardt"], parameters, Span(0.01, 0.2), {})
    peak = peak_of(law, 1.0)
    assert peak.found == falls
    assert np.all(np.isfinite(peak.by_law))
    if falls:
        slip = np.log(c1 * c2 / c3) / c2
        assert peak.slip == pytest.approx(slip, rel=0.02)
        assert peak.adhesion == pytest.approx(c1 * (1 - np.exp(-c2 * slip)) - c3 * slip, rel=1e-6)


def test_a_peak_among_the_points_counts_where_the_law_rises_higher_beyond_them():
    curve, factors = CURVES["magic-formula"], np.append(0.2, np.zeros(FUNCTIONS - 1))
    parameters = np.append([100.0, 2.4, 0.3, 1.02], factors)
    law = FittedLaw(curve, parameters, Span(0.01, 0.1), {})
    heights = law.at(np.linspace(0.0, 1.0, 100_001)).adhesion
    first = int(heights[:10_000].argmax())
    assert heights.argmax() > 40_000  # the second hump
    peak = peak_of(law, 1.0)
    assert peak.found
    assert peak.slip == pytest.approx(first * 1e-5, abs=2e-5)
    assert peak.adhesion == pytest.approx(heights[first], rel=1e-6)
    among = law._replace(span=Span(0.01, 0.6))
    assert peak_of(among, 1.0).slip > 0.2


def test_points_without_a_fall_tell_what_is_reached_at_least(tmp_path):
    slip = np.linspace(0.001, 0.015, 163)
    record = drawn(CURVES["burckhardt"], slip, 0.0005, seed=2)
    table = pd.DataFrame({"slip_ratio": slip, "adhesion": record.adhesion})
    table.to_csv(tmp_path / "rise.csv", index=False)
    result = CliRunner().invoke(
        main,
        [str(tmp_path / "rise.csv"), "--curve", "burckhardt", "--out", str(tmp_path / "out")],
        catch_exceptions=False,
    )
    said = " ".join(result.output.split())
    top = float(CURVES["burckhardt"](jnp.asarray(0.015), {}))
    reached = float(re.search(r"mu_max at least (0\.\d+)", said)[1])
    assert reached == pytest.approx(top, abs=0.003)
    assert "Adhesion is not seen to fall up to the largest slip, 0.015" in said
    assert "no other curve was fitted to compare it with" in said
    assert len(pd.read_csv(tmp_path / "out" / "curves.csv")) == 1


def test_a_curve_bends_where_it_misses_the_points(fits, eurosprinter):
    """Coulomb's friction cannot fall: its departure does, and then no structure is left."""
    assert fits["polach"].misfit > 3 * fits["kiencke"].misfit
    run = np.zeros(eurosprinter.slip.size, dtype=int)
    left = residual_structure(fits["polach"], arranged(eurosprinter, run, ()))
    assert abs(left.slope) < 2 * left.slope_se
    assert abs(left.likeness) < 2
    assert left.scatter == pytest.approx(0.0244, abs=0.00005)
    # Behind the peak it falls as the straight line of least squares through the points does.
    slip, adhesion = np.asarray(eurosprinter.slip), np.asarray(eurosprinter.adhesion)
    behind = slip > 0.04
    line, covariance = np.polyfit(slip[behind], adhesion[behind], 1, cov=True)
    ends = fits["polach"].law.at(np.array([0.05, 0.19])).adhesion
    assert abs(np.diff(ends)[0] / 0.14 - line[0]) < 2 * np.sqrt(covariance[0, 0])


@pytest.mark.parametrize(
    ("lowest", "words"), [(0.05, "slip ratio (1)"), (0.001, "stretched near 0")]
)
def test_the_scale_of_slip_is_even_where_slips_are_of_one_size(lowest, words):
    slip = np.linspace(lowest, 0.2, 60)
    record = drawn(CURVES["kiencke"], slip, 0.001, seed=3)
    found = aj.identify(pd.DataFrame({"slip_ratio": slip, "adhesion": record.adhesion}), "kiencke")
    above, below = found.plot().axes
    assert below.get_xlabel().endswith(words)
    assert (above.get_xscale() == "linear") == (words == "slip ratio (1)")


def test_correlation_in_time_is_measured_within_runs():
    truth = CURVES["burckhardt"]
    slip = np.tile(np.linspace(0.002, 0.2, 500), 4)
    noise = np.random.default_rng(5).standard_normal(slip.size)
    for k in range(1, slip.size):
        noise[k] = 0.8 * noise[k - 1] + 0.6 * noise[k]
    record = record_of(slip, np.asarray(truth(jnp.asarray(slip), {})) + 0.01 * noise)
    timed = record._replace(conditions={"time_s": jnp.arange(slip.size, dtype=float)})
    fit = fit_measured(truth, timed, False, np.repeat(np.arange(4), 500))
    assert fit.noise.autocorrelation == pytest.approx(0.8, abs=0.06)


def test_force_and_load_and_braking_give_the_same_fit(tmp_path, fits):
    """Units and signs do not matter: force in newtons, and a third of the points braking."""
    table = read_measured(SHIPPED["eurosprinter"].path).table
    side = np.where(np.arange(163) % 3 == 0, -1, 1)
    table["slip_ratio"] *= side
    table["tangential_force_N"] = side * table["adhesion"] * table["normal_load_N"]
    force = table.drop(columns=["adhesion", "slip_velocity_mps"])
    force.to_parquet(tmp_path / "force.parquet", index=False)
    record = to_record(read_measured(tmp_path / "force.parquet"))
    for name in ("burckhardt", "kiencke"):
        fit = fit_measured(CURVES[name], record, False)
        assert fit.rms == pytest.approx(fits[name].rms, rel=1e-5)
        np.testing.assert_allclose(fit.parameters, fits[name].parameters, rtol=1e-5)
        np.testing.assert_allclose(fit.standard_errors, fits[name].standard_errors, rtol=1e-4)


@pytest.mark.long
def test_slip_as_a_velocity_gives_the_same_curve_in_its_own_unit(tmp_path, fits):
    table = read_measured(SHIPPED["eurosprinter"].path).table
    # Exactly ten times the ratio, which the file gives to six digits.
    velocity = pd.DataFrame(
        {"slip_velocity_mps": 10 * table["slip_ratio"], "adhesion": table["adhesion"]}
    )
    velocity.to_csv(tmp_path / "velocity.csv", index=False)
    record = to_record(read_measured(tmp_path / "velocity.csv"))
    for name in ("burckhardt", "polach-falling"):
        fit, ratio = fit_measured(CURVES[name], record, True), fits[name]
        assert fit.slip_unit == " m/s"
        assert fit.rms == pytest.approx(ratio.rms, rel=1e-9)
        assert float(fit.peak.slip) == pytest.approx(10 * float(ratio.peak.slip), rel=1e-4)
        assert fit.slip_opt_se == pytest.approx(10 * ratio.slip_opt_se, rel=1e-3)
        assert fit.mu_max_se == pytest.approx(ratio.mu_max_se, rel=1e-3)
    np.testing.assert_allclose(
        fit.parameters[2], ratio.parameters[2], rtol=1e-3
    )  # b, in s/m in both


@pytest.mark.long
def test_a_curve_whose_condition_is_missing_is_named(tmp_path):
    table = read_measured(SHIPPED["eurosprinter"].path).table[["slip_ratio", "adhesion"]]
    path, out = tmp_path / "plain.csv", tmp_path / "out"
    table.to_csv(path, index=False)
    told = CliRunner().invoke(main, [str(path), "--out", str(out)], catch_exceptions=False)
    assert "polach-falling was not fitted: it needs the column vehicle_speed_mps" in " ".join(
        told.output.split()
    )
    row = pd.read_csv(out / "curves.csv").set_index("curve").loc["polach-falling"]
    assert row["status"] == "NOT_FITTED: it needs the column vehicle_speed_mps."
    assert row.drop("status").isna().all()
    with pytest.raises(InputError, match="lacks the column vehicle_speed_mps, which"):
        CliRunner().invoke(main, [str(path), "--curve", "polach-falling"], catch_exceptions=False)


def test_the_search_on_some_points_is_polished_on_all():
    truth, points = CURVES["burckhardt"], 30_001
    slip = np.random.default_rng(0).permutation(np.linspace(0.001, 0.2, points))
    record = drawn(truth, slip, 0.01, seed=0)
    fit = fit_measured(truth, record, False)
    exact = least_squares(
        lambda x: FORMULAS["burckhardt"](slip, *x) - np.asarray(record.adhesion),
        [truth.c1, truth.c2, truth.c3],
        x_scale=[truth.c1, truth.c2, truth.c3],
        xtol=1e-14,
        ftol=1e-14,
        loss="huber",
        f_scale=2 * fit.noise.sigma,
    )
    assert fit.points == points
    assert fit.misfit < 1e-3
    fitted = fit.law.at(np.array([0.01, 0.05, 0.1, 0.2])).adhesion
    expected = FORMULAS["burckhardt"](np.array([0.01, 0.05, 0.1, 0.2]), *exact.x)
    np.testing.assert_allclose(fitted, expected, atol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["eurosprinter", "--curve", "burkhardt"], "--curve burkhardt is not known; name one of"),
        (
            ["eurosprinter", "--curve", "kiencke", "--out", "/proc/none"],
            "--out /proc/none cannot be written to",
        ),
        ([], "Missing argument 'FILES...'"),
    ],
)
def test_the_command_refuses_in_one_sentence(arguments, says, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["identify", *arguments])
    with pytest.raises(SystemExit) as ended:
        run(main)
    assert ended.value.code == 2
    said = capsys.readouterr()
    assert said.err.startswith(f"error: {says}")
    assert said.err.count("\n") == 1
    # Nothing is printed but how the columns are understood, where that much can be said.
    assert said.out == "" or said.out.split("\n")[0].endswith(" are used.")


def test_a_process_of_its_own_ends_with_status_2_and_no_traceback():
    ended = subprocess.run(
        [sys.executable, "-m", "adhesion_jax", "identify", "eurosprinder"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    assert ended.stderr == f"error: eurosprinder does not exist; {WANTED}.\n"


def a_log(path, events=True):
    """20 minutes at 10 Hz with two events on a known curve, written to a file."""
    time = 0.1 * np.arange(12_000)
    chance = np.random.default_rng(0)
    slip = 0.002 + 2e-4 * chance.standard_normal(time.size)
    for begin in (200.0, 800.0) if events else ():
        inside = (time - begin) / 8
        slip += np.where((inside > 0) & (inside < 1), 0.12 * np.sin(np.pi * inside) ** 2, 0.0)
    adhesion = FORMULAS["burckhardt"](slip, 0.3, 80.0, 0.3) + 0.003 * chance.standard_normal(
        time.size
    )
    columns = {"time_s": time, "vehicle_speed_mps": SPEED, "slip_ratio": slip, "adhesion": adhesion}
    pd.DataFrame(columns).to_parquet(path)
    return str(path)


@pytest.mark.thorough
def test_a_log_is_cut_into_its_events_and_drawn(tmp_path):
    file, out = a_log(tmp_path / "log.parquet"), tmp_path / "out"
    asked = [file, "--curve", "burckhardt", "--out", str(out)]
    result = CliRunner().invoke(main, asked, catch_exceptions=False)
    assert result.exit_code == 0
    said = " ".join(result.output.split())
    assert "2 slip events cut out of log.parquet (20 min) are runs" in said
    assert {path.name for path in out.iterdir()} == FILES | {"events.png"}
    told = " ".join((out / "verdict.txt").read_text().split())
    assert "of 12,000 rows with a slip are used" in told.split("Curve:")[0]
    row = pd.read_csv(out / "curves.csv").loc[0]
    # Where c1 c2 exp(-c2 s) = c3.
    assert row["slip_opt"] == pytest.approx(np.log(0.3 * 80 / 0.3) / 80, rel=0.05)
    # All rows are used where that is asked for, and the figure of an earlier job is removed.
    result = CliRunner().invoke(main, [*asked, "--whole"], catch_exceptions=False)
    assert "All 12,000 rows are used: as asked for." in " ".join(result.output.split())
    assert {path.name for path in out.iterdir()} == FILES


def test_a_log_without_an_event_is_refused_and_nothing_written(tmp_path):
    file, out = a_log(tmp_path / "log.parquet", events=False), tmp_path / "out"
    with pytest.raises(InputError, match=r"log.parquet has no slip event: .* --whole\.$"):
        CliRunner().invoke(main, [file, "--out", str(out)], catch_exceptions=False)
    assert not out.exists()


def test_the_departure_is_from_the_nearest_curve_of_the_name(fits, eurosprinter):
    """Its parameters are those of least squares through the law at the slips of the points."""
    fit = fits["burckhardt"]
    assert fit.departure.size > 0.1
    slip = np.asarray(eurosprinter.slip)
    law = fit.law.at(slip).adhesion
    start = CURVES["burckhardt"]
    exact = least_squares(
        lambda x: FORMULAS["burckhardt"](slip, *x) - law,
        [start.c1, start.c2, start.c3],
        x_scale=[0.1, 10.0, 0.1],
        xtol=1e-14,
        ftol=1e-14,
    )
    np.testing.assert_allclose(fit.parameters, exact.x, rtol=0.02)
    missed = np.sqrt(2 * exact.cost / np.sum(law**2))
    assert fit.misfit == pytest.approx(missed, rel=0.02)


def test_the_law_that_is_saved_is_the_law_of_the_fit(told, fits):
    slip = np.linspace(0.0, 0.3, 61)
    law = load_law(told[0] / "law.json")
    densities = log_densities(fits)
    best = fits[max(fits, key=lambda name: densities[name])]
    speed = {"vehicle_speed_mps": best.conditions["vehicle_speed_mps"]}
    saved = np.asarray(law(jnp.asarray(slip), speed))
    np.testing.assert_allclose(saved, best.law.at(slip).adhesion, rtol=1e-12)
