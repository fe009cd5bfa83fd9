"""Scenarios declare what a user may change, and the command line follows from that."""

import pickle
from typing import Annotated

import click
import pytest
from click.testing import CliRunner

from adhesion_jax.command_line.catalogue import told
from adhesion_jax.command_line.montecarlo import scenario_options
from adhesion_jax.errors import InputError
from adhesion_jax.options import Option, Sigma, arguments_of, check, declared
from adhesion_jax.scenarios import SCENARIOS, Options, build
from adhesion_jax.scenarios.noise import Noise

Gradient = Annotated[float, Option("Gradient of the track, per mille.", -40, 40)]


def hill(gradient: Gradient, sigma: Sigma = 0.01) -> tuple[float, float]:
    """A scenario of its own, with an option that no other has and that it cannot do without."""
    return gradient, sigma


def test_what_was_not_asked_for_is_left_out_and_equal_options_are_one_key():
    asked = Options(points=200, sigma=0.1, rail=None)
    assert dict(asked) == {"points": 200, "sigma": 0.1}
    again = Options(sigma=0.1, points=200)
    assert asked == again
    assert len({asked, again, Options(sigma=0.1)}) == 2
    assert pickle.loads(pickle.dumps(asked)) == asked
    assert Options(sigma=0.0) != Options()


def test_defaults_stand_in_the_arguments_and_are_what_is_built():
    scenario = build("single")
    assert scenario.rails == ("dry",)
    assert (scenario.noise.sigma, scenario.noise.outliers) == (0.01, 0.0)
    assert scenario.excitation.points == 500
    assert scenario.excitation.slip_max == 0.2
    assert build("single", Options(sigma=0.0)).noise.sigma == 0.0


def test_an_option_is_described_where_it_is_declared():
    found = declared(hill)
    assert {name: (one.kind, one.required) for name, one in found.items()} == {
        "gradient": (float, True),
        "sigma": (float, False),
    }
    # Where the scenario works out the default itself the annotation is a union with None.
    assert declared(SCENARIOS["fang2018-slope"])["slip_max"].kind is float


def bumpy(
    gradient: Gradient, noise: Noise = Noise(0.02, autocorrelation=0.5)
) -> tuple[float, Noise]:
    """A scenario with a part, whose fields are options with the defaults of the argument."""
    return gradient, noise


def test_a_part_of_a_scenario_brings_its_options():
    found = declared(bumpy)
    assert [*found] == ["gradient", "sigma", "outliers", "autocorrelation"]
    assert [one.required for one in found.values()] == [True, False, False, False]
    assert found["sigma"] == declared(hill)["sigma"]
    made = arguments_of(bumpy, Options(gradient=1.0))
    assert made == {"gradient": 1.0, "noise": Noise(0.02, 0.0, 0.5)}
    made = arguments_of(bumpy, Options(gradient=1.0, sigma=0.1))
    assert made == {"gradient": 1.0, "noise": Noise(0.1, 0.0, 0.5)}
    assert build("coloured", Options(sigma=0.1)).noise == Noise(0.1, 0.0, 0.8)
    assert hill(**arguments_of(hill, Options(gradient=1.0))) == (1.0, 0.01)


def test_what_does_not_go_together_is_said_with_what_would_be_right():
    with pytest.raises(InputError, match=r"--blocks does not go with --scenario hill.*--gradient"):
        check("hill", declared(hill), Options(gradient=1.0, blocks=3))
    with pytest.raises(InputError, match=r"hill needs --gradient\. Gradient of the track"):
        check("hill", declared(hill), Options())
    check("hill", declared(hill), Options(gradient=1.0, sigma=0.2))


@pytest.mark.long
def test_the_command_line_has_the_options_of_a_new_scenario_in_their_ranges(monkeypatch):
    monkeypatch.setitem(SCENARIOS, "hill", hill)
    known = pickle.loads(pickle.dumps(told()))
    assert known.scenarios["hill"].words.startswith("A scenario of its own")

    @click.command()
    @scenario_options(known.scenarios)
    def command(**options: object) -> None:
        click.echo(repr(Options(**options)))

    def said(*words: str) -> str:
        return CliRunner().invoke(command, [*words]).output

    assert said("--gradient", "12.5", "--blocks", "7") == "Options(gradient=12.5, blocks=7)\n"
    assert "-40<=x<=40" in said("--gradient", "41")
    assert "not a finite number" in said("--gradient", "nan")
    help_text = " ".join(said("--help").split())
    assert "Gradient of the track, per mille. For hill." in help_text
    assert "Noise of the adhesion signal. [" in help_text  # which every scenario has
