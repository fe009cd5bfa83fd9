"""Rails from the files of an identification and of a discovery."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import adhesion_jax as aj
from adhesion_jax.curves import Burckhardt, Exponential, Polach
from adhesion_jax.curves.bent import Bent
from adhesion_jax.effects import KINDS
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.saved import save_law
from adhesion_jax.errors import InputError
from adhesion_jax.measured.rails import rails_of_curves, rails_of_law
from adhesion_jax.traction.rails import Passed

CURVE = Exponential(a=22.0, b=50.0, c=0.7)
NOW, KEY = jnp.zeros((), dtype=int), jax.random.key(0)
SPEED = jnp.asarray(5.0)
RUN_ORDER = Calendar("run_order", 0.0, 1.0)


def metadata(folder, *taken):
    columns = {"log.csv": [{"column": name, "taken_as": name} for name in taken]}
    (folder / "metadata.json").write_text(json.dumps({"columns": columns}))


def saved(folder, *effects, curve=CURVE, **ranges):
    metadata(folder, "slip_ratio", "vehicle_speed_mps", "adhesion")
    ranges = {"vehicle_speed_mps": (1.0, 30.0), **ranges}
    path = folder / "law.json"
    save_law(path, CorrectedLaw(curve, effects, ranges, RUN_ORDER))
    return path


def made(name, **fields):
    return KINDS[name](**fields)


@pytest.mark.long
@pytest.mark.parametrize(
    ("taken", "in_ratio"),
    [
        (("slip_velocity_mps", "adhesion"), False),
        (("slip_velocity_mps", "vehicle_speed_mps", "adhesion"), True),
        (("slip_ratio", "adhesion"), True),
    ],
)
def test_the_best_curve_of_a_file_is_a_surface_in_the_slip_of_its_points(tmp_path, taken, in_ratio):
    metadata(tmp_path, *taken)
    curve = Burckhardt(c1=0.3, c2=40.0, c3=0.5)
    bent = Bent(curve, np.array([0.02, -0.01]), 0.02, 0.2)
    save_law(tmp_path / "law.json", bent)
    table = tmp_path / "curves.csv"
    with pytest.raises(InputError, match="does not exist"):
        rails_of_curves(table)
    table.write_text("curve,rms\nburckhardt,.001\n")
    rails = rails_of_curves(table).draw(KEY, 1e-4)
    surface = rails.present((), NOW, NOW, SPEED)
    grid = jnp.geomspace(1e-3, 1.0, 20_001)
    adhesion, peak = jax.jit(lambda: (surface(grid, SPEED), surface.peak(SPEED)))()
    np.testing.assert_allclose(adhesion, bent(grid / (5.0 if in_ratio else 1.0), {}), rtol=1e-12)
    assert np.abs(adhesion / curve(grid / (5.0 if in_ratio else 1.0), {}) - 1).max() > 0.005
    assert float(peak.adhesion) == pytest.approx(float(adhesion.max()), rel=1e-6)
    assert float(peak.slip) == pytest.approx(float(grid[adhesion.argmax()]), rel=1e-3)


EFFECTS = {
    "cleaning": made("cleaning", k=0.4, work=0.05, load_power=0.0),
    "hysteresis": made("hysteresis", k=0.2, rate=0.05, memory=0.05),
    "relaxation": made("relaxation", length=0.5),
    "speed": made("speed", k=-0.3, reference=5.0),
}


@pytest.mark.long
@pytest.mark.parametrize("names", [("cleaning",), ("hysteresis", "speed"), tuple(EFFECTS)])
def test_effects_with_a_memory_advance_with_the_train(tmp_path, names):
    effects = tuple(EFFECTS[name] for name in names)
    rails = rails_of_law(saved(tmp_path, *effects)).draw(KEY, 1e-4)
    step, count = 1e-3, 1500
    times = step * jnp.arange(count)
    ratios = jnp.stack([0.02 + 0.01 * jnp.sin(3 * times), 0.03 + 0.02 * jnp.cos(5 * times)], 1)
    speeds = 5.0 + times

    def one(state, now):
        ratio, speed = now
        surface = rails.present(state, NOW, NOW, speed)
        adhesion = surface(ratio * speed, speed)
        # An axle may have several contacts.
        twice = surface(jnp.stack([ratio, ratio]) * speed, speed)
        state = rails.update(state, Passed(NOW, ratio * speed, adhesion, speed), step)
        return state, (adhesion, twice)

    begin = rails.init(ratios[0] * speeds[0], speeds[0])
    found, twice = jax.jit(lambda: jax.lax.scan(one, begin, (ratios, speeds)))()[1]
    np.testing.assert_array_equal(twice[:, 0], twice[:, 1])
    np.testing.assert_array_equal(twice[:, 0], found)
    law = CorrectedLaw(CURVE, effects, {"vehicle_speed_mps": (1.0, 30.0)}, RUN_ORDER)
    for axle in range(2):
        columns = {"time_s": times, "vehicle_speed_mps": speeds}
        expected = np.asarray(jax.jit(law)(ratios[:, axle], columns))
        bare = np.asarray(CURVE(ratios[:, axle], {}))
        assert np.abs(expected - bare).max() > 0.01
        # Memories stand still for a step, and the rate of the slip is not known at the start.
        np.testing.assert_allclose(found[700:, axle], expected[700:], atol=2e-3)


@pytest.mark.long
def test_the_peak_is_that_at_the_moment_and_without_a_lag(tmp_path):
    effects = (EFFECTS["cleaning"], EFFECTS["relaxation"])
    rails = rails_of_law(saved(tmp_path, *effects)).draw(KEY, 1e-4)

    @jax.jit
    def peaks():
        state = rails.init(jnp.array([0.1, 0.2]), SPEED)
        for _ in range(3):
            passed = Passed(NOW, jnp.array([0.1, 0.2]), jnp.array([0.1, 0.2]), SPEED)
            state = rails.update(state, passed, 0.5)
        return rails.present(state, NOW, NOW, SPEED).peak(SPEED), CURVE.peak({})

    found, bare = peaks()
    np.testing.assert_allclose(found.slip, 5.0 * float(bare.slip), rtol=1e-3)
    work = np.abs(CURVE(jnp.array([0.02, 0.04]), {})) * np.array([0.1, 0.2]) * 1.5
    cleaned = 1 + 0.4 * (1 - np.exp(-np.asarray(work) / 0.05))
    np.testing.assert_allclose(found.adhesion, cleaned * float(bare.adhesion), rtol=1e-6)


@pytest.mark.parametrize("stiffness", [20.0, 150.0, 1000.0])
def test_a_peak_in_slip_velocity_is_found_however_small_it_is(tmp_path, stiffness):
    path = saved(tmp_path, EFFECTS["cleaning"], curve=Burckhardt(c1=0.3, c2=stiffness, c3=0.15))
    metadata(tmp_path, "slip_velocity_mps", "adhesion")
    rails = rails_of_law(path).draw(KEY, 1e-4)

    @jax.jit
    def peak():
        return rails.present(rails.init(jnp.array([0.1]), SPEED), NOW, NOW, SPEED).peak(SPEED)

    found = peak()
    # d/dv [c1 (1 - exp(-c2 v)) - c3 v] = 0
    best = np.log(0.3 * stiffness / 0.15) / stiffness
    np.testing.assert_allclose(found.slip, best, rtol=1e-3)
    np.testing.assert_allclose(
        found.adhesion, 0.3 * (1 - np.exp(-stiffness * best)) - 0.15 * best, rtol=1e-6
    )


def test_all_laws_are_drawn_with_the_same_noise(tmp_path):
    laws = rails_of_law(saved(tmp_path)), rails_of_law(saved(tmp_path, EFFECTS["cleaning"]))
    assert laws[0].drawn_as == laws[1].drawn_as is not None


def test_what_is_of_the_measurement_is_not_on_the_rail(tmp_path):
    effects = made("lag", time_constant=0.4), made("torque_offset", offset=0.01)
    rails = rails_of_law(saved(tmp_path, *effects)).draw(KEY, 1e-4)
    slip = jnp.array([0.05, 0.4])
    found = rails.present((), NOW, NOW, SPEED)(slip, SPEED)
    np.testing.assert_allclose(found, CURVE(slip / 5, {}), rtol=1e-12)


def test_a_file_that_is_no_rail_is_refused_in_a_sentence(tmp_path):
    column = made(
        "memory", k=0.1, time_constant=1.0, reference=0.0, scale=1.0, column="temperature_C"
    )
    with pytest.raises(InputError, match="temperature_C with a memory, and a train on its way"):
        rails_of_law(saved(tmp_path, column, temperature_C=(0.0, 30.0)))
    with pytest.raises(InputError, match="rests on relative_humidity_pct and has no range of it"):
        rails_of_law(
            saved(tmp_path, made("humidity", k=-0.1, centre=50.0, width=10.0, reference=50.0))
        )
    with pytest.raises(InputError, match="has no peak at slips up to 1 where the train runs"):
        rails_of_law(saved(tmp_path, curve=Polach(mu0=0.3, stiffness=100.0)))
    path = saved(tmp_path)
    (tmp_path / "metadata.json").unlink()
    with pytest.raises(InputError, match=r"not known whether law[.]json is in slip ratio"):
        rails_of_law(path)


@pytest.mark.long
def test_a_curve_of_points_that_gave_no_answer_is_a_rail_that_is_doubted(tmp_path):
    slip = np.geomspace(0.002, 0.4, 60)
    level = 20 * np.asarray(Burckhardt(c1=0.3, c2=40.0, c3=0.5)(jnp.asarray(slip), {}))
    points = {"slip_ratio": slip, "adhesion": level + 0.02 * np.cos(np.arange(60.0))}
    found = aj.identify(points, "burckhardt", {"adhesion": "adhesion [1]"}, out=tmp_path)
    assert found.vetoes
    doubt = rails_of_curves(tmp_path / "curves.csv").doubt
    assert doubt.startswith("The points that these rails were fitted to gave no answer")
    assert doubt.endswith(" ".join(found.vetoes))
    metadata(tmp_path, "slip_ratio", "adhesion")
    assert rails_of_curves(tmp_path / "curves.csv").doubt == ""
