"""Every number of the three systems has a tag, and every printed one stands where it is said to.

The texts of the papers are not part of the project: where they are absent, the places are not
looked up.
"""

import re
from pathlib import Path

import jax
import numpy as np
import pytest

from adhesion_jax.traction.plants.reading import TAGS, read_plant, shipped
from adhesion_jax.traction.systems import SYSTEMS, fang2018, hxd1f, uyulan2018
from adhesion_jax.traction.systems.base import built

PAPERS = Path(__file__).parents[3] / "shared" / "papers"
TEXTS = {
    "uyulan2018": "uyulan2018_optimal_slip_velocity_seeking.txt",
    "fang2018": "fang2018_adhesion_state_observation.txt",
    "hxd1f": "hxd1f2019_extremum_seeking_barrier_lyapunov.txt",
}

#: Where a printed parameter of a plant stands: these words with its number, @, and the number as
#: the text has it.
PLACES = {
    ("uyulan2018", "radius_right"): (r"Nominal wheel radius\t\S+\t@ m\b", "0.31"),
    ("uyulan2018", "radius_left"): (r"Nominal wheel radius\t\S+\t@ m\b", "0.31"),
    ("uyulan2018", "gear_ratio"): (r"Gear ratio\t\$n_k\$\t@\n|Gear ratio\tn_k\t@\n", "6.92"),
    ("uyulan2018", "motor_inertia"): (r"inertia of the traction motor\t\S+\t@ kg", "3.5138"),
    ("uyulan2018", "gear_inertia"): (r"inertia of the gearbox and axle\t.*\t@ kg", "340"),
    ("uyulan2018", "axle_inertia"): (r"inertia of the gearbox and axle\t.*\t@ kg", "340"),
    ("uyulan2018", "wheel_inertia"): (r"inertia of the right or left wheel\t\S+\t@ kg", "240"),
    ("uyulan2018", "brake_inertia"): (r"inertia of the brake system\t\S+\t@ kg", "420"),
    ("uyulan2018", "shaft_stiffness"): (
        r"Spring constant of the left wheel\t\S+\t@ N/m",
        "6,063,260",
    ),
    ("uyulan2018", "shaft_damping"): (
        r"Damping coefficient of the left wheel\t\S+\t@ Ns/m",
        "50,000",
    ),
    ("uyulan2018", "axles_alike"): (r"there exist @ traction motors in total", "four"),
    ("uyulan2018", "axles"): (r"each bogie has two wheelset .* assumed to have @ bogies", "three"),
    ("uyulan2018", "curve_radius"): (r"Radius of the track curvature\t\S+\t@ m", "6200"),
    ("fang2018", "axles_alike"): (
        r"the adhesion control study mainly aimed at the @ axle",
        "single",
    ),
    ("hxd1f", "axle_load"): (r"single axle weight of @ tons?", "30"),
    ("hxd1f", "axles_alike"): (r"the HHEL with @ axles", "eight"),
}

#: What the words of a place stand for.
WORDS = {"four": 4.0, "single": 1.0, "eight": 8.0, "30": 30000.0, "three": 6.0}

#: Printed numbers of the systems: where they stand, and what is used.
PRINTED = {
    ("uyulan2018", "initial speed"): (r"V\(0\) = @ \\text\{ m/s\}", "10.5", 10.5),
    ("uyulan2018", "initial rotation"): (r"\\omega_\{w,k\}\(0\) = @ \\text", "50", 50.0),
    ("uyulan2018", "slope"): (r"Slope angle of the rail\t\S+\t@°", "6.5", 6.5),
    ("uyulan2018", "adaptation"): (r"Adaptation rate\t\S+\t@\n", "19", 19.0),
    ("uyulan2018", "gain"): (r"Free parameter\t\S+\t@\n", "12,500", 12500.0),
    ("uyulan2018", "gamma"): (r"Estimator parameter\t\S+\t@\n", "0.65", 0.65),
    ("uyulan2018", "threshold"): (r"Small threshold\t\S+\t@\n", "0.0001", 1e-4),
    ("uyulan2018", "step"): (r"fixed step time of @ s", "0.0001", 1e-4),
    ("uyulan2018", "switch"): (r"slip velocity switches every @ s", "10", 10.0),
    ("uyulan2018", "dry"): (r"\nDry\t@\n", "0.54\t1.20\t1.00\t1.00", (0.54, 1.2, 1.0)),
    ("uyulan2018", "wet"): (r"\nWet\t@\n", "0.54\t1.20\t0.35\t0.35", (0.54, 1.2, 0.35)),
    ("uyulan2018", "low"): (r"\nLow\t@\n", "0.54\t1.20\t0.10\t0.10", (0.54, 1.2, 0.1)),
    ("uyulan2018", "very low"): (r"\nVery low\t@\n", "0.54\t1.00\t0.05\t0.05", (0.54, 1.0, 0.05)),
    ("fang2018", "K1"): (r"K_1 = @,", "19000", 19000.0),
    ("fang2018", "K2"): (r"K_2 = @\)", "7000", 7000.0),
    ("fang2018", "until"): (r"speeds up from 0 to @ km/h", "130", 130.0),
    ("fang2018", "down to"): (r"regenerative braking to @ km/h", "25", 25.0),
    ("fang2018", "road 2 from"): (r"in the @~85 km/h section", "55", 55.0),
    ("fang2018", "road 3 from"): (r"in the @~110 km/h section", "85", 85.0),
    ("fang2018", "braking"): (r"in the @~70 km/h section", "105", 105.0),
    ("fang2018", "best slip of road 3"): (r"v_\{sopt3\} = @\$? km/h", "4", 4.0),
    ("hxd1f", "dry until"): (r"the 0-@s wheel-rail surface is dry", "5", 5.0),
    ("hxd1f", "snow from"): (r"\n?@-15s rail surface is rain and snow", "10", 10.0),
    ("hxd1f", "best slip dry"): (r"slip speed of the dry track at @ \(m/s\)", "0.2", 0.2),
    ("hxd1f", "best slip wet"): (r"search value stabled in @\(m/s\)", "0.08", 0.08),
    ("hxd1f", "power"): (r"locomotive traction power reaches @kW", "9600", 9600e3),
}


def text_of(system):
    path = PAPERS / TEXTS[system]
    if not path.exists():
        pytest.skip("the text of the paper is not at hand")
    return path.read_text(encoding="utf-8")


def used(system):
    """The printed numbers of PRINTED as the package has them."""
    if system == "uyulan2018":
        case = uyulan2018.SYSTEM.cases(uyulan2018.SYSTEM.step)[1]
        rotation = (uyulan2018.SYSTEM.train_speed + uyulan2018.SYSTEM.slip) / 0.31
        laws = {name: (s.law.a, s.law.b, s.law.c) for name, s in uyulan2018.SURFACES.items()}
        return {
            "initial speed": uyulan2018.SYSTEM.train_speed,
            "initial rotation": rotation,
            "slope": np.degrees(uyulan2018.SYSTEM.slope),
            "adaptation": case.controller.adaptation,
            "gain": case.controller.gain,
            "gamma": case.seeker.gamma,
            "threshold": case.seeker.threshold,
            "step": uyulan2018.SYSTEM.step,
            "switch": case.seeker.switch,
            **laws,
        }
    if system == "fang2018":
        case, driver = fang2018.SYSTEM.cases(1e-4)[0], fang2018.SYSTEM.driver
        return {
            "K1": case.controller.slope_gain,
            "K2": case.controller.adhesion_gain,
            "until": 3.6 * driver.until,
            "down to": 3.6 * driver.down_to,
            "road 2 from": 3.6 * case.rails.in_traction[0],
            "road 3 from": 3.6 * case.rails.in_traction[1],
            "braking": 3.6 * case.rails.in_braking[0],
            "best slip of road 3": fang2018.PRINTED_BEST_SLIP_KMH["3"],
        }
    plant = read_plant(shipped()["hxd1f"]).plant
    return {
        "dry until": hxd1f.STARTS[1],
        "snow from": hxd1f.STARTS[2],
        "best slip dry": hxd1f.PRINTED_BEST_SLIP["dry"],
        "best slip wet": hxd1f.PRINTED_BEST_SLIP["wet"],
        "power": 8 * float(plant.power_limit),
    }


def printed_parameters():
    for name in TEXTS:
        for parameter, given in read_plant(shipped()[name]).given.items():
            if given.tag == "P":
                yield name, parameter


def test_every_number_of_a_plant_has_a_tag_and_where_it_is_from():
    for path in shipped().values():
        for name, given in read_plant(path).given.items():
            assert given.tag in TAGS, (path.stem, name)
            assert given.source or given.tag in "AK", (path.stem, name)


def test_the_places_are_those_of_the_printed_parameters():
    assert set(printed_parameters()) == set(PLACES)


@pytest.mark.parametrize("key", PLACES, ids="-".join)
def test_a_printed_parameter_stands_at_its_place_in_the_paper(key):
    system, parameter = key
    place, number = PLACES[key]
    (value,) = read_plant(shipped()[system]).given[parameter].value
    assert value == (WORDS.get(number) or float(number.replace(",", "")))
    assert re.search(place.replace("@", re.escape(number)), text_of(system))


@pytest.mark.parametrize("key", PRINTED, ids="-".join)
def test_a_printed_number_of_a_system_stands_at_its_place_in_the_paper(key):
    system, name = key
    place, number, value = PRINTED[key]
    np.testing.assert_allclose(used(system)[name], value, rtol=1e-12)
    assert re.search(place.replace("@", re.escape(number)), text_of(system))


#: The numbers of the loops beside the plant and the printed ones: each stands in a sentence of the
#: repairs or of the assumptions of its system.
TOLD = {
    "uyulan2018": {
        ".controller.linear": ".0154",
        ".controller.square": ".00467",
        ".controller.layer": "layer of .05 m/s",
        ".observer.gain": "L = 400",
        ".seeker.gain": "differentiators",
        ".seeker.limit": "limited to 1 s/m",
        ".seeker.start": "1.20986",
        ".driver.traction": "17.67 kN m",
    },
    "fang2018": {
        ".controller.gamma": "gamma = 10",
        ".controller.first_p": "P(0) = 10",
        ".controller.first_slope": "beta(0) = .3",
        ".controller.filter_time": "50 ms",
        ".observer.pole": "-30 1/s",
    },
}


@pytest.mark.parametrize("system", TOLD)
def test_every_number_of_a_loop_is_printed_or_told(system):
    chosen = SYSTEMS[system]
    plant = read_plant(shipped()[chosen.plant]).plant
    case = chosen.cases(chosen.step)[1 if system == "uyulan2018" else 0]
    loop = built(chosen, case, plant)
    leaves, _ = jax.tree_util.tree_flatten_with_path(loop)
    names = {jax.tree_util.keystr(path) for path, _ in leaves}
    parts = {name for name in names if re.match(r"\.(controller|observer|seeker)\.", name)}
    sentences = " ".join((*chosen.repairs, *chosen.assumptions))
    printed = {name for of, name in PRINTED if of == system}
    for name in parts:
        field = name.rsplit(".", 1)[1]
        short = {"slope_gain": "K1", "adhesion_gain": "K2"}.get(field, field)
        if name not in TOLD[system]:
            assert short in printed, name
    for name, words in TOLD[system].items():
        assert name in names
        assert words in sentences, name
