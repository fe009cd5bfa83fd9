"""Which accepted causes are named, and which by their columns alone."""

import numpy as np
import pytest
from discovery_campaigns import campaign, curve, noise, state_of

from adhesion_jax.discovery.findings.dependence import dependences
from adhesion_jax.discovery.findings.found import contradiction, intervals, vetoed
from adhesion_jax.discovery.search.state import Accepted
from adhesion_jax.discovery.types import Interval
from adhesion_jax.effects import EFFECTS, Covariate
from adhesion_jax.wording import number


def accepted(name, *parts, members=()):
    kind = EFFECTS[name]
    covariates = kind.FACTS.rests_on
    return Accepted(
        name, (name, *members), kind.FACTS.family, False, covariates, parts, 0.001, 50.0
    )


SPEED = EFFECTS["speed"](k=0.5, reference=12.0)
SAND = EFFECTS["sanding"](k=0.2, build_up=1.0, decay=5.0)
WARMTH = EFFECTS["temperature"](k=0.001, reference=10.0)
TURN = EFFECTS["hysteresis"](k=3.0, rate=0.8, memory=1.0)
AXLES = EFFECTS["axle_position"](k1=0.1, k2=0.0, k3=0.0, k4=0.0, k5=0.0)


@pytest.mark.parametrize(
    ("name", "part", "strengths", "held_back", "said"),
    [
        ("speed", SPEED, {"k": (0.5, 0.3, 0.7)}, 0.0, ""),
        (
            "speed",
            SPEED,
            {"k": (-0.5, -0.7, -0.3)},
            0.0,
            "its k is -0.5, and it would have to be",
        ),
        # A tenth of the gain, which is 50, is what the end of a range may hold back.
        ("speed", SPEED, {"k": (5.0, 4.0, 6.0)}, 5.1, "its k stands at 5, an end of the range"),
        ("speed", SPEED, {"k": (0.5, -0.1, 1.1)}, 0.0, "the interval of its k holds 0"),
        ("sanding", SAND, {"k": (-0.2, -0.3, -0.1)}, 0.0, "its k is -0.2"),
        # Adhesion may rise or fall with the temperature.
        ("temperature", WARMTH, {"k": (-0.01, -0.02, -0.005)}, 0.0, ""),
        (
            "hysteresis",
            TURN,
            {"k": (3.0, 2.7, 3.3)},
            10.0,
            "its k stands at 3, an end of the range",
        ),
        ("hysteresis", TURN, {"k": (3.0, 2.7, 3.3)}, 4.9, ""),
        # One axle that differs is enough.
        ("axle_position", AXLES, {"k1": (0.1, 0.05, 0.15)}, 0.0, ""),
        (
            "axle_position",
            AXLES,
            {"k1": (0.1, -0.05, 0.25)},
            0.0,
            "its k1, k2, k3, k4 and k5 holds 0",
        ),
        # The rail gets cleaner from axle to axle: none is surely worse than one before it.
        (
            "axle_position",
            AXLES,
            {"k1": (-0.04, -0.05, -0.03)},
            0.0,
            "its k1 is -0.04, and it would have to be above the reference",
        ),
        (
            "axle_position",
            AXLES,
            {"k1": (0.2, 0.15, 0.25), "k2": (0.2, 0.1, 0.3), "k3": (0.1, 0.08, 0.12)},
            0.0,
            "its k3 is 0.1, and it would have to be above k1",
        ),
    ],
)
def test_a_cause_is_contradicted_by_the_end_the_sign_or_the_interval_of_its_strength(
    name, part, strengths, held_back, said
):
    found = {strength: Interval(0.0, -0.1, 0.1) for strength in part.FACTS.strengths}
    found |= {strength: Interval(*values) for strength, values in strengths.items()}
    why = contradiction(accepted(name, part), found, held_back)
    assert said in why
    assert bool(said) == bool(why)


def test_with_a_form_that_refines_it_an_interval_alone_is_no_contradiction():
    line = Covariate(0.1, 0.0, 1.0, column="vehicle_speed_mps", acts_on="level")
    found = {"k": Interval(0.5, -0.1, 1.1)}
    assert contradiction(accepted("speed", SPEED, line), found, 0.0) == ""
    assert contradiction(accepted("speed", SPEED), found, 0.0)
    plain = accepted("speed", line)._replace(name="covariate:vehicle_speed_mps", generic=True)
    assert contradiction(plain, {}, 0.0) == ""


@pytest.mark.thorough
@pytest.mark.parametrize("rises", [False, True])
def test_adhesion_that_rises_with_speed_is_not_named_a_fall_with_it(rises):
    draw = np.random.default_rng(8)
    table = campaign(draw)
    speed = 10.0 + 3.0 * table["warm"]
    table = table.assign(vehicle_speed_mps=speed)
    factor = np.exp((0.02 if rises else -0.02) * (speed - speed.mean()))
    table = table.assign(adhesion=curve(table["slip_ratio"]) * factor + noise(draw))
    members = ("falling_friction", "covariate:vehicle_speed_mps", "drift")
    state = state_of(table, accepted("speed", SPEED, members=members))
    named, sentences = vetoed(state)
    assert named.fitted is state.fitted
    if not rises:
        assert sentences == ()
        assert named.accepted == state.accepted
        return
    (effect,) = named.accepted
    assert effect.name == "covariate:vehicle_speed_mps"
    assert effect.members[0] == effect.name
    assert "speed" not in effect.members
    assert "drift" in effect.members
    assert effect.parts == state.accepted[0].parts
    (words,) = sentences
    assert words.startswith("Vehicle speed is not named as a cause, although its formula is in ")


@pytest.mark.long
def test_what_the_data_lack_has_no_interval_and_adhesion_that_falls_to_the_rear_no_cleaning():
    """Axle B, behind A, has 4 % less adhesion; of further axles nothing is known."""
    draw = np.random.default_rng(8)
    table = campaign(draw)
    rear = table["run"] % 2
    adhesion = curve(table["slip_ratio"]) * (1 - 0.04 * rear) + noise(draw)
    table = table.assign(axle=np.where(rear, "B", "A"), adhesion=adhesion)
    start = AXLES.starts({})[0]
    state = state_of(table, accepted("axle_position", start)._replace(covariates=("axle",)))
    ((_, found),) = intervals(state).items()
    assert found.keys() == {"k1"}
    np.testing.assert_allclose(found["k1"].value, -0.04, atol=0.01)
    (effect,), (words,) = vetoed(state)[0].accepted, vetoed(state)[1]
    assert (effect.name, effect.generic) == ("covariate:axle", True)
    assert words == (
        "Position of the axle is not named as a cause, although its formula is in the law: its k1 "
        f"is {number(found['k1'].value)}, and it would have to be above the reference."
    )
    (shown,) = [one for one in dependences(vetoed(state)[0], 0) if one.column == "axle"]
    assert shown.labels == ("A", "B")
