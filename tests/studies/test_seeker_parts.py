"""What each part of a seeker buys: the parts that are switched off, and intervals of the peak."""

from operator import attrgetter

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from adhesion_jax.leaderboard.judging import keys_of
from adhesion_jax.leaderboard.runs import TILE, tile
from adhesion_jax.leaderboard.terms import SAMPLED, Grid, timing_of
from adhesion_jax.traction.entrants import ENTRANTS, box, configured
from adhesion_jax.traction.families import FAMILIES
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import terms_of
from experiments.seeker_parts import RAILS, RESULTS, compared, point

BOARD = pd.read_csv(RESULTS / "leaderboard.csv")
TUNED = BOARD[BOARD["rails"] == RAILS].set_index("method")["tuned"]


@pytest.mark.parametrize("name", ["offset-curve", "riv", "perturb-and-observe", "constant-slip"])
def test_the_numbers_of_a_board_are_those_of_its_words(name):
    method = ENTRANTS[name]
    at = configured(method, jnp.asarray(point(method, TUNED[name])))
    told = [float(words.split()[-1]) for words in TUNED[name].split(", ")]
    assert [float(attrgetter(place)(at)) for place in box(method)] == pytest.approx(told, rel=1e-6)


def test_every_seeker_differs_from_the_whole_one_in_its_part_alone():
    of = compared()
    whole = of["whole"][1]
    for words, (name, seeker) in of.items():
        if name == "offset-curve":
            same = [
                field for field in vars(whole) if getattr(seeker, field) == getattr(whole, field)
            ]
            assert len(vars(whole)) - len(same) == (words == "without detection")
        else:
            shared = ENTRANTS[name].seeker.seeker
            assert seeker.spacing * seeker.block == pytest.approx(shared.spacing * shared.block)


@pytest.mark.thorough
def test_two_errors_of_the_peak_hold_the_truth_as_often_as_they_say():
    method, system, family = ENTRANTS["offset-curve"], SYSTEMS["hxd1f"], FAMILIES[RAILS]
    plant = read_plant(shipped()["hxd1f"]).plant
    terms = terms_of(system, plant, Sensors(system.noise, period=SAMPLED))
    timing = timing_of(terms, Grid(), "offset-curve", method, family)
    points = np.tile(point(method, TUNED["offset-curve"]), (TILE, 1))
    course = tile(
        terms, timing, method, family, points, keys_of(300, RAILS, np.arange(TILE))
    ).course
    last = np.diff(course.segment, axis=1, append=9) != 0
    for what in ("slip", "adhesion"):
        found, peak, error = (
            getattr(course, name)[..., 0][last]
            for name in (f"found_{what}", f"peak_{what}", f"found_{what}_se")
        )
        assert len(found) == 3 * TILE
        assert 0.90 <= np.mean(np.abs(found - peak) < 1.96 * error) <= 0.98
