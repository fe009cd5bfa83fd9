"""What every planted effect makes of adhesion, by numbers worked out outside the package.

The expected adhesion was calculated from the formulas in words, point by point with Python's math
module, on two runs of four points: one of traction, one of braking.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import signal

from experiments.campaigns.plantable import PLANTABLE, CleanRuns
from experiments.discovery_study.otherwise import OTHERWISE as OTHER_FORMS

SLIP = np.array([[0.01, 0.04, 0.09, 0.16], [-0.16, -0.09, -0.04, -0.01]])
COLUMNS = {
    "time_s": [[100.0, 100.5, 101.0, 101.5], [200.0, 200.5, 201.0, 201.5]],
    "run": [[0, 0, 0, 0], [1, 1, 1, 1]],
    "vehicle_speed_mps": [[10.0, 11.0, 12.0, 13.0], [20.0, 19.0, 18.0, 17.0]],
    "normal_load_N": [[80e3, 90e3, 100e3, 100e3], [100e3, 110e3, 120e3, 125e3]],
    "temperature_C": [[0.0, 5.0, 10.0, 15.0], [15.0, 20.0, 25.0, 30.0]],
    "relative_humidity_pct": [[40.0, 50.0, 60.0, 62.0], [62.0, 70.0, 80.0, 90.0]],
    "position_m": [[0.0, 50.0, 100.0, 150.0], [200.0, 300.0, 400.0, 500.0]],
    "curvature_per_m": [[0.0, 1e-3, -2e-3, 3e-3], [0.0, -1e-3, 2e-3, 4e-3]],
    "gradient_permille": [[-8.0, 0.0, 4.0, 8.0], [8.0, 12.0, -4.0, 0.0]],
    "sanding": [[0.0, 1.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0]],
    "axle": [[1.0, 2.0, 3.0, 4.0], [4.0, 3.0, 2.0, 1.0]],
    "angle_of_attack_deg": [[0.0, 1.0, -2.0, 3.0], [-0.5, 0.5, 2.0, 0.0]],
    "wheel_angle_rad": [[0.0, 0.5, 1.0, 1.5], [2.0, 2.5, 3.0, 3.5]],
    "groove_depth_um": [[20.0, 30.0, 40.0, 50.0], [60.0, 65.0, 70.0, 80.0]],
    "rail_age_days": [[1.0, 21.0, 41.0, 61.0], [61.0, 81.0, 101.0, 121.0]],
}
#: What follows from the columns.
FOLLOWING = {
    "acceleration_mps2": [[2.0] * 4, [-2.0] * 4],
    "mode": [[1.0] * 4, [-1.0] * 4],
    "lateral_measure": np.tan(np.deg2rad(COLUMNS["angle_of_attack_deg"])),
    "campaign_time": [[0.0, 0.1, 0.2, 0.3], [0.7, 0.8, 0.9, 1.0]],
}
PHASE = np.pi / 6


class Known(np.random.Generator):
    """Draws that are known: a quarter of the way up, and a quarter more for each next of many."""

    def __init__(self, chosen=1):
        super().__init__(np.random.PCG64(0))
        self.chosen = chosen

    def uniform(self, low, high, size=()):
        shares = 0.25 * (1 + np.arange(np.prod(size, dtype=int))).reshape(size)
        drawn = low + shares * (high - low)
        return drawn if size else float(drawn)

    def integers(self, low, high=None):
        return self.chosen if high is None else low + self.chosen

    def standard_normal(self, size):
        return np.resize([0.5, -1.0, 2.0, -0.25, 1.5], size)


def runs_of(slip, columns, conditions) -> CleanRuns:
    """Runs whose curve is the root of the slip: .1, .2, .3, .4, then -.4, -.3, -.2, -.1."""
    return CleanRuns(
        slip=np.asarray(slip),
        columns={name: np.asarray(values) for name, values in columns.items()},
        conditions={name: jnp.asarray(values, dtype=float) for name, values in conditions.items()},
        curve=lambda slip: np.sign(slip) * np.sqrt(np.abs(slip)),
        generator=Known(),
        phase=PHASE,
    )


RUNS = runs_of(SLIP, COLUMNS, {**COLUMNS, **FOLLOWING})


#: By the formula of the cause itself: the amount, then adhesion in either run.
EXACT = {
    "speed": (
        2.0,
        [0.11449866827, 0.22219891793, 0.32394275494, 0.42043865131],
        [-0.36000367374, -0.27523359157, -0.18720705741, -0.095589758701],
    ),
    "slip_speed": (
        0.3,
        [0.097044553355, 0.17526819902, 0.21697507271, 0.21431878307],
        [-0.15315715439, -0.17960903748, -0.16114706037, -0.095027867053],
    ),
    "falling_friction": (
        0.4,
        [0.097670581343, 0.18143788317, 0.24277090957, 0.28593254078],
        [-0.26345711394, -0.22301254179, -0.17193675013, -0.096121182067],
    ),
    "load_peak": (
        0.5,
        [0.11180339887, 0.21081851068, 0.3, 0.4],
        [-0.4, -0.28603877677, -0.18257418584, -0.0894427191],
    ),
    "load_slope": (
        0.5,
        [0.10573712634, 0.20533801922, 0.3, 0.4],
        [-0.4, -0.2929362269, -0.19108855844, -0.0945741609],
    ),
    "humidity": (
        0.2,
        [0.11236113549, 0.21062830713, 0.30196705624, 0.4],
        [-0.4, -0.29426452813, -0.1936264514, -0.096212887749],
    ),
    "temperature": (
        0.02,
        [0.07, 0.16, 0.27, 0.4],
        [-0.4, -0.33, -0.24, -0.13],
    ),
    "contact_heating": (
        2.0,
        [0.099367544468, 0.18938680067, 0.24388155383, 0.2153957747],
        [-0.1710266391, -0.22938583711, -0.1864235498, -0.099175378875],
    ),
    "patch": (
        0.3,
        [0.09970999464, 0.19117856285, 0.23837229996, 0.28280688804],
        [-0.34881631971, -0.2997897298, -0.19999999325, -0.1],
    ),
    "cleaning": (
        0.5,
        [0.1, 0.20799878671, 0.35187774105, 0.54550511521],
        [-0.4, -0.36718283935, -0.25397082433, -0.12749449721],
    ),
    "sanding": (
        0.5,
        [0.1, 0.23934693403, 0.39481808382, 0.51379277866],
        [-0.4, -0.3, -0.2, -0.1],
    ),
    "axle_position": (
        0.5,
        [0.12, 0.27, 0.45, 0.6],
        [-0.6, -0.45, -0.27, -0.12],
    ),
    "relaxation": (
        8.0,
        [0.1, 0.12768459316, 0.19548949426, 0.28516187467],
        [-0.4, -0.35852776685, -0.27903207571, -0.1889042131],
    ),
    "delay": (
        0.2,
        [0.1, 0.16, 0.26, 0.36],
        [-0.4, -0.34, -0.24, -0.14],
    ),
    "lag": (
        0.8,
        [0.1, 0.12564182856, 0.1858407675, 0.2645367947],
        [-0.4, -0.37435817144, -0.3141592325, -0.2354632053],
    ),
    "hysteresis": (
        0.3,
        [0.12993695141, 0.25998716363, 0.38999980083, 0.51999997299],
        [-0.28000002701, -0.21000019917, -0.14001283637, -0.070063048585],
    ),
    "curve": (
        50.0,
        [0.1, 0.19, 0.27, 0.34],
        [-0.4, -0.285, -0.18, -0.08],
    ),
    "lateral_creep": (
        2.0,
        [0.1, 0.17359895886, 0.26665019204, 0.36583929879],
        [-0.39881879977, -0.29724381208, -0.14099458305, -0.1],
    ),
    "load_transfer": (
        0.1,
        [0.12, 0.24, 0.36, 0.48],
        [-0.32, -0.24, -0.16, -0.08],
    ),
    "mode_asymmetry": (
        0.2,
        [0.12, 0.24, 0.36, 0.48],
        [-0.32, -0.24, -0.16, -0.08],
    ),
    "slip_bias": (
        0.02,
        [0.17320508076, 0.24494897428, 0.33166247904, 0.42426406871],
        [-0.42426406871, -0.33166247904, -0.24494897428, -0.17320508076],
    ),
    "torque_offset": (
        0.03,
        [0.13, 0.23, 0.33, 0.43],
        [-0.43, -0.33, -0.23, -0.13],
    ),
    "inertia": (
        0.02,
        [0.1524, 0.2592, 0.3724, 0.4828],
        [-0.3776, -0.2908, -0.2096, -0.1192],
    ),
    "wheel_order": (
        0.3,
        [0.12598076211, 0.2533190609, 0.30848294831, 0.30558416229],
        [-0.2866632126, -0.27895768692, -0.24150944667, -0.12944175411],
    ),
    "rail_joint": (
        0.3,
        [0.12598076211, 0.2, 0.22205771366, 0.50392304845],
        [-0.4, -0.37794228634, -0.14803847577, -0.1],
    ),
    "drift": (
        0.2,
        [0.060050840651, 0.12010168147, 0.1801527163, 0.2404067252],
        [-0.40020336227, -0.30015252195, -0.2001016813, -0.10005084065],
    ),
    "slip_noise": (
        0.01,
        [0.1, 0.2, 0.3, 0.4],
        [-0.4, -0.3, -0.2, -0.1],
    ),
    "torsion": (
        0.05,
        [0.15, 0.15380602337, 0.33535533906, 0.38086582838],
        [-0.4, -0.28086582838, -0.23535533906, -0.053806023374],
    ),
    "unknown_column": (
        0.3,
        [0.16178049082, 0.27562213645, 0.352178877, 0.4],
        [-0.4, -0.25555195351, -0.14512622431, -0.061812150214],
    ),
    "product": (
        0.3,
        [0.22281650015, 0.22712227698, 0.28877017322, 0.4],
        [-0.4, -0.38199506879, -0.14369202901, -0.082633356395],
    ),
    "periodic": (
        0.3,
        [0.10800901297, 0.23591977294, 0.21001283737, 0.47504493572],
        [-0.42811197528, -0.36926861141, -0.14527002389, -0.12647255198],
    ),
}

#: By the other formula.
OTHERWISE = {
    "speed": (
        0.5,
        [0.08, 0.1568627451, 0.23076923077, 0.30188679245],
        [-0.26666666667, -0.20338983051, -0.13793103448, -0.070175438596],
    ),
    "slip_speed": (
        0.5,
        [0.090702947846, 0.13437248052, 0.12649687974, 0.096116878124],
        [-0.059171597633, -0.087183324736, -0.10813148789, -0.08494552868],
    ),
    "falling_friction": (
        0.4,
        [0.094285714286, 0.16615384615, 0.22285714286, 0.27582089552],
        [-0.26526315789, -0.21116883117, -0.15636363636, -0.091168831169],
    ),
    "load_peak": (
        0.5,
        [0.085777777778, 0.164, 0.23333333333, 0.31111111111],
        [-0.31111111111, -0.21933333333, -0.136, -0.065277777778],
    ),
    "load_slope": (
        0.5,
        [0.087038827978, 0.16872981624, 0.24494897428, 0.32659863237],
        [-0.32659863237, -0.23680111139, -0.15249857033, -0.074926864927],
    ),
    "humidity": (
        0.2,
        [0.098617231593, 0.18924234315, 0.26126062163, 0.34279663154],
        [-0.34279663154, -0.24598502935, -0.16087525084, -0.080089925463],
    ),
    "temperature": (
        0.5,
        [0.1, 0.20277777778, 0.31666666667, 0.45],
        [-0.45, -0.36666666667, -0.26944444444, -0.15],
    ),
    "contact_heating": (
        4.0,
        [0.088771229024, 0.13066259286, 0.13350679833, 0.12093533262],
        [-0.10356879929, -0.11676770097, -0.11913111649, -0.085842493316],
    ),
    "patch": (
        0.3,
        [0.1, 0.2, 0.247185832, 0.28361844275],
        [-0.37, -0.3, -0.2, -0.1],
    ),
    "cleaning": (
        0.4,
        [0.054652688364, 0.11732919671, 0.21182892401, 0.3510317773],
        [-0.35235378706, -0.27917568951, -0.18806975202, -0.094140670923],
    ),
    "sanding": (
        0.5,
        [0.1, 0.2, 0.45, 0.6],
        [-0.4, -0.45, -0.29, -0.14],
    ),
    "axle_position": (
        0.5,
        [0.1, 0.25, 0.4125, 0.575],
        [-0.575, -0.4125, -0.25, -0.1],
    ),
    "relaxation": (
        8.0,
        [0.1, 0.17098914164, 0.28420179108, 0.39618344151],
        [-0.4, -0.30359725188, -0.21367419942, -0.13176409161],
    ),
    "delay": (
        0.6,
        [0.1, 0.1, 0.174, 0.274],
        [-0.4, -0.4, -0.308, -0.208],
    ),
    "lag": (
        0.8,
        [0.1, 0.15090754049, 0.23098559007, 0.32359987583],
        [-0.4, -0.34909245951, -0.26901440993, -0.17640012417],
    ),
    "hysteresis": (
        0.3,
        [0.13, 0.26, 0.39, 0.52],
        [-0.28, -0.21, -0.14, -0.07],
    ),
    "curve": (
        0.4,
        [0.1, 0.16, 0.22, 0.28],
        [-0.4, -0.24, -0.14666666667, -0.068],
    ),
    "lateral_creep": (
        2.0,
        [0.1, 0.16631535878, 0.2557454134, 0.35179189307],
        [-0.39645827382, -0.29351094958, -0.13594976912, -0.1],
    ),
    "load_transfer": (
        0.1,
        [0.109993293, 0.21998658599, 0.32997987899, 0.43997317199],
        [-0.36002682801, -0.27002012101, -0.18001341401, -0.090006707003],
    ),
    "mode_asymmetry": (
        0.2,
        [0.1, 0.2, 0.3, 0.4],
        [-0.32470588235, -0.246, -0.168, -0.09],
    ),
    "slip_bias": (
        0.02,
        [0.17378147197, 0.24657656012, 0.33436506995, 0.42801869118],
        [-0.42801869118, -0.33436506995, -0.24657656012, -0.17378147197],
    ),
    "torque_offset": (
        0.03,
        [0.136, 0.2366, 0.3372, 0.4378],
        [-0.442, -0.3414, -0.2408, -0.1402],
    ),
    "inertia": (
        0.02,
        [0.1536, 0.25938595604, 0.37232146749, 0.47972607608],
        [-0.3804, -0.29004326007, -0.20851660259, -0.11766168934],
    ),
    "wheel_order": (
        0.3,
        [0.12242676114, 0.22987797821, 0.28843774013, 0.25754938285],
        [-0.30672650003, -0.35252933227, -0.25004721054, -0.11676447707],
    ),
    "rail_joint": (
        0.3,
        [0.098134704279, 0.15593337968, 0.29995989442, 0.39253881712],
        [-0.31186675937, -0.29440411284, -0.19997326294, -0.077966689842],
    ),
    "drift": (
        0.2,
        [0.1, 0.19934854872, 0.29806156074, 0.39615460505],
        [-0.32299802694, -0.24221190017, -0.16145058436, -0.080713479867],
    ),
    "slip_noise": (
        0.01,
        [0.1, 0.2, 0.3, 0.4],
        [-0.4, -0.3, -0.2, -0.1],
    ),
    "torsion": (
        0.05,
        [0.15, 0.15380602337, 0.33535533906, 0.38086582838],
        [-0.4, -0.28086582838, -0.23535533906, -0.053806023374],
    ),
    "unknown_column": (
        0.3,
        [0.1, 0.17955443781, 0.24911383877, 0.31438057562],
        [-0.31438057562, -0.22699880426, -0.14747086829, -0.072462549959],
    ),
    "product": (
        0.3,
        [0.13427173702, 0.2, 0.27920472792, 0.4],
        [-0.4, -0.34073167141, -0.17227297056, -0.1],
    ),
    "periodic": (
        0.3,
        [0.12942166376, 0.16566917608, 0.24167567276, 0.51916779407],
        [-0.30107420166, -0.38659550427, -0.18482327802, -0.12718671039],
    ),
}

#: What the truth of a simulated set says besides the amount, where something was drawn or measured.
DRAWN = {
    "speed": {"k": 2.0, "reference": 15.0},
    "falling_friction": {"drop": 0.4, "b": 0.6},
    "load_peak": {"p": 0.5, "reference": 100e3},
    "load_slope": {"p": 0.5, "reference": 100e3},
    "humidity": {"k": -0.2, "centre": 35.0, "width": 25.0, "reference": 62.0},
    "temperature": {"k": 0.02, "reference": 15.0},
    "patch": {"depth": 0.3, "centre": 140.0, "width": 65.0, "flatness": 2.0},
    "cleaning": {"k": 0.5, "work": 0.475, "load_power": 1.0},
    "sanding": {"k": 0.5, "build_up": 1.0, "decay": 4.75},
    "axle_position": {"k1": 0.2, "k2": 0.35, "k3": 0.5, "k4": 0.5, "k5": 0.5},
    "hysteresis": {"k": 0.3, "rate": 0.0175, "memory": 0.0},
    "lateral_creep": {"gain": 2.0, "offset": 0.0},
    "wheel_order": {"sine": 0.15, "cosine": 0.3 * np.sqrt(0.75), "order": 2.0},
    "rail_joint": {"sine": 0.15, "cosine": 0.3 * np.sqrt(0.75), "length": 15.0},
    "drift": {"k": 0.2, "centre": 0.4, "width": 0.03, "reference": 0.5},
    "torsion": {"amplitude": 0.05, "frequency_hz": 1.125},
    "unknown_column": {"k": -0.3, "reference": 61.0, "scale": np.sqrt(1400)},
    # The mean of the gradients is 2.5, their variance 39.75; of the temperatures 15 and 87.5.
    "product": {"k": 0.3, "first_scale": np.sqrt(39.75), "second_scale": np.sqrt(87.5)},
    "periodic": {"sine": 0.15, "cosine": 0.3 * np.sqrt(0.75), "frequency": 1 / 15.5},
}


def by_its_formula(name, runs=RUNS, chosen=1):
    return PLANTABLE[name].form(runs._replace(generator=Known(chosen)))


def otherwise(name, runs=RUNS):
    return OTHER_FORMS.get(name, PLANTABLE[name].form)(runs)


def adhesion_of(planted, runs=RUNS):
    return planted.after(runs.curve(planted.before(runs.slip)))


@pytest.mark.parametrize("name", PLANTABLE)
def test_a_cause_by_its_own_formula_makes_the_adhesion_that_was_worked_out(name):
    amount, *expected = EXACT[name]
    planted = by_its_formula(name).make(amount)
    np.testing.assert_allclose(adhesion_of(planted), expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("name", PLANTABLE)
def test_a_cause_by_another_formula_makes_the_adhesion_that_was_worked_out(name):
    amount, *expected = OTHERWISE[name]
    planted = otherwise(name).make(amount)
    np.testing.assert_allclose(adhesion_of(planted), expected, rtol=1e-9, atol=1e-11)


def test_every_cause_has_its_numbers_here():
    assert set(EXACT) == set(OTHERWISE) == set(PLANTABLE)


@pytest.mark.parametrize("name", PLANTABLE)
def test_without_an_amount_nothing_is_planted(name):
    for plan in (by_its_formula(name), otherwise(name)):
        planted = plan.make(0.0)
        np.testing.assert_allclose(adhesion_of(planted), RUNS.curve(SLIP), rtol=1e-9, atol=1e-11)
        np.testing.assert_array_equal(planted.measured(SLIP), SLIP)


@pytest.mark.parametrize("name", PLANTABLE)
def test_the_truth_says_what_was_drawn(name):
    amount = EXACT[name][0]
    told = by_its_formula(name).make(amount).parameters
    if name in DRAWN:
        assert {key: told[key] for key in DRAWN[name]} == pytest.approx(DRAWN[name], rel=1e-12)
    else:  # the amount alone
        assert [abs(value) for value in told.values() if value] == [amount]
    if not PLANTABLE[name].is_noise:
        assert otherwise(name).make(0.4).parameters == {"amount": 0.4}


@pytest.mark.parametrize(
    ("name", "chosen", "expected"),
    [
        ("humidity", 0, (62.0, 150.0)),
        ("humidity", 1, (35.0, 25.0)),
        ("humidity", 2, (72.0, 8.0)),
        ("drift", 0, (0.5, 3.0)),
        ("drift", 1, (0.4, 0.03)),
    ],
)
def test_causes_of_several_kinds_have_each_of_them(name, chosen, expected):
    told = by_its_formula(name, chosen=chosen).make(0.3).parameters
    assert (told["centre"], told["width"]) == pytest.approx(expected)


def test_noise_of_the_slip_is_on_the_slip_signal_alone():
    for plan in (by_its_formula("slip_noise"), otherwise("slip_noise")):
        planted = plan.make(0.01)
        expected = [[0.015, 0.03, 0.11, 0.1575], [-0.145, -0.085, -0.05, 0.01]]
        np.testing.assert_allclose(planted.measured(SLIP), expected, rtol=1e-12)
        np.testing.assert_array_equal(planted.before(SLIP), SLIP)


@pytest.mark.parametrize("name", [name for name in PLANTABLE if name != "slip_noise"])
def test_every_other_cause_leaves_the_slip_signal_as_it_is(name):
    for plan in (by_its_formula(name), otherwise(name)):
        np.testing.assert_array_equal(plan.make(0.05).measured(SLIP), SLIP)


#: The orders in which causes act by both forms, where they are not those of a factor: 1. In the
#: other form heating and cleaning are factors that do not depend on the adhesion.
ORDERS = {
    **dict.fromkeys(("load_slope", "slip_bias", "lateral_creep"), (0,)),
    **dict.fromkeys(("contact_heating", "cleaning"), (1, 2)),
    **dict.fromkeys(("relaxation", "delay", "lag", "inertia", "torque_offset", "torsion"), (3,)),
    "slip_noise": (4,),
}


@pytest.mark.parametrize("name", PLANTABLE)
def test_what_bends_the_slip_acts_first_and_what_is_in_the_signals_last(name):
    orders = {plan.make(0.05).order for plan in (by_its_formula(name), otherwise(name))}
    assert orders == {*ORDERS.get(name, (1,))}


# ------------------------------------------------------------------- filters, against scipy.signal


def long_runs(points=60):
    """Three runs at 10 Hz and a speed of 12 m/s, whose adhesion is a random walk."""
    slip = 0.08 + 0.01 * np.cumsum(np.random.default_rng(0).standard_normal((3, points)), axis=1)
    slip = np.abs(slip)
    columns = {
        "time_s": 0.1 * np.arange(points) + 1000 * np.arange(3)[:, None],
        "vehicle_speed_mps": np.full((3, points), 12.0),
    }
    return runs_of(slip, columns, columns)


def through(time_constant, values):
    """1/(T s + 1) by scipy, for straight lines between points; it starts settled."""
    filtered = []
    for run in values:
        times = 0.1 * np.arange(run.size)
        system = signal.lti([1.0], [time_constant, 1.0]).to_ss()
        settled = np.linalg.solve(-system.A, system.B[:, 0] * run[0])
        filtered.append(signal.lsim(system, run, times, X0=settled)[1])
    return np.stack(filtered)


def in_steps(time_constant, values):
    """The same for signals that are steps, as a digital filter."""
    kept = np.exp(-0.1 / time_constant)
    b, a = [1 - kept], [1, -kept]
    return signal.lfilter(b, a, values, zi=kept * values[:, :1])[0]


def test_lags_are_those_of_scipy():
    runs = long_runs()
    bare = runs.curve(runs.slip)
    for time_constant in (0.05, 0.7, 6.0):
        lag = by_its_formula("lag", runs).make(time_constant)
        np.testing.assert_allclose(lag.after(bare), through(time_constant, bare), rtol=1e-9)
        twice = in_steps(time_constant / 2, in_steps(time_constant / 2, bare))
        lag = otherwise("lag", runs).make(time_constant)
        np.testing.assert_allclose(lag.after(bare), twice, rtol=1e-9)


def test_relaxation_at_constant_speed_is_a_lag_of_the_length_over_the_speed():
    runs = long_runs()
    bare = runs.curve(runs.slip)
    relaxed = by_its_formula("relaxation", runs).make(6.0)
    np.testing.assert_allclose(relaxed.after(bare), through(0.5, bare), rtol=1e-9)
    # The other form at a slip of .05 throughout: half the length.
    still = runs._replace(slip=np.full_like(runs.slip, 0.05))
    relaxed = otherwise("relaxation", still).make(12.0)
    np.testing.assert_allclose(relaxed.after(bare), in_steps(0.5, bare), rtol=1e-9)


def test_the_other_inertia_and_hysteresis_have_passed_filters_of_scipy():
    runs = long_runs()
    bare = runs.curve(runs.slip)
    rate = np.gradient(12.0 * (1 + runs.slip), 0.1, axis=1)
    found = otherwise("inertia", runs).make(0.02).after(bare)
    np.testing.assert_allclose(found, bare + 0.02 * in_steps(0.15, rate), rtol=1e-9)
    direction = np.sign(np.gradient(runs.slip, 0.1, axis=1))
    found = otherwise("hysteresis", runs).make(0.2).after(bare)
    np.testing.assert_allclose(found, bare * (1 + 0.2 * in_steps(0.3, direction)), rtol=1e-9)


def test_a_delay_of_whole_samples_is_a_shift():
    runs = long_runs()
    bare = runs.curve(runs.slip)
    late = by_its_formula("delay", runs).make(0.3).after(bare)
    np.testing.assert_allclose(late[:, 3:], bare[:, :-3], rtol=1e-9)
    np.testing.assert_allclose(late[:, :3], np.repeat(bare[:, :1], 3, axis=1), rtol=1e-12)
