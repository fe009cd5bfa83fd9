"""Two columns at once: a joint effect is one claim, a sum of two effects is two."""

import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import SIZE, state_of
from numpy.polynomial.legendre import legval
from scipy import stats

from adhesion_jax.discovery.search.catalogue import column_entries, library_of
from adhesion_jax.discovery.search.probes import null_of
from adhesion_jax.discovery.search.screening import screen
from adhesion_jax.discovery.search.selection import _next, _pairs, search
from adhesion_jax.discovery.search.state import as_effect
from adhesion_jax.effects import Covariate, Interaction, Surface
from adhesion_jax.effects.shape import ACTS_ON
from experiments.campaigns.simulator import simulate


def places(column: pd.Series) -> pd.Series:
    """A column on -1 to 1 over its range."""
    return 2 * (column - column.min()) / np.ptp(column) - 1


def shares(column: pd.Series) -> np.ndarray:
    """A column on -1 to 1 by the share of the logistic distribution of its moments below it."""
    scale = np.sqrt(3) / np.pi * np.std(column)
    return 2 * stats.logistic.cdf(column, np.mean(column), scale) - 1


@pytest.fixture(scope="module")
def null():
    return simulate(seed=4, base="burckhardt", **SIZE).train


def searched(table):
    state = state_of(table)
    return search(state, library_of(state.setting.problem), 0, lambda *_: None)


@pytest.mark.thorough
def test_what_acts_through_two_columns_together_is_one_effect_of_both(null):
    u, v = shares(null["position_m"]), shares(null["rail_age_days"])
    found = searched(null.assign(adhesion=null["adhesion"] * np.exp(0.2 * u * v)))
    (effect,) = found.accepted
    assert {*effect.covariates} == {"position_m", "rail_age_days"}
    surface = effect.parts[0]
    assert isinstance(surface, Surface)
    assert float(surface.k11) == pytest.approx(0.2, rel=0.05)
    bare = searched(null)
    assert bare.accepted == ()
    # Nothing of the effect is left; its own parameters take up a little of the scatter of the runs.
    left, least = (np.sum(one.fitted.error[:17, :100] ** 2) for one in (found, bare))
    assert 0.92 < left / least < 1.02


@pytest.mark.thorough
def test_what_acts_through_each_of_two_columns_is_two_effects(null):
    u, v = places(null["position_m"]), places(null["rail_age_days"])
    found = searched(null.assign(adhesion=null["adhesion"] * np.exp(0.15 * u + 0.15 * v)))
    assert sorted(effect.covariates for effect in found.accepted) == [
        ("position_m",),
        ("rail_age_days",),
    ]


@pytest.mark.thorough
def test_what_an_accepted_column_does_with_another_one_is_found_beside_it(null):
    """A surface is too smooth for what the first column does alone, of which no cause is known."""
    table = null.rename(columns={"position_m": "x"})
    u, v = shares(table["x"]), shares(table["rail_age_days"])
    acting = 0.15 * np.cos(2 * np.pi * u) + 0.08 * u * v
    found = searched(table.assign(adhesion=null["adhesion"] * np.exp(acting)))
    alone, both = found.accepted
    assert alone.covariates == ("x",)
    assert {*both.covariates} == {"x", "rail_age_days"}
    assert float(both.parts[0].k11) == pytest.approx(0.08, rel=0.15)


@pytest.mark.thorough
def test_what_two_accepted_columns_do_together_is_found_whatever_its_degrees(null):
    """Of the mixed term of a surface, P_1(u) P_1(v), there is nothing in it."""
    u, v = shares(null["position_m"]), shares(null["relative_humidity_pct"])
    acting = 0.2 * u + 0.2 * v + 0.15 * legval(u, [0, 0, 1]) * legval(v, [0, 0, 0, 1])
    found = searched(null.assign(adhesion=null["adhesion"] * np.exp(acting)))
    *alone, both = found.accepted
    assert {effect.covariates for effect in alone} == {("position_m",), ("relative_humidity_pct",)}
    (mixed,) = both.parts
    assert isinstance(mixed, Interaction)
    assert (mixed.first, mixed.second) == ("position_m", "relative_humidity_pct")
    assert float(mixed.k23) == pytest.approx(0.15, rel=0.15)


def test_mixed_terms_are_of_pairs_with_a_column_that_an_effect_rests_on(null):
    """They are open for a pair that is but a member of a class, and not for one that is named."""
    state = state_of(null)
    columns = ["position_m", "rail_age_days", "temperature_C"]
    assert not [one for one in _pairs(state, columns) if isinstance(one.starts[0], Interaction)]
    pair = "product:position_m*rail_age_days"
    first, second = (f"product:{name}*temperature_C" for name in columns[:2])
    for own, name, members, expected in (
        (("position_m",), "covariate:position_m", (pair,), {pair, first}),
        (("rail_age_days", "position_m"), pair, (), {first, second}),
    ):
        (line,) = column_entries(Covariate, "position_m", state.setting.problem)[:1]
        one = as_effect(line, (name, *members), line.starts[0], 0.001, 9.0)
        accepted = (one._replace(name=name, covariates=own),)
        entries = _pairs(state._replace(accepted=accepted), columns)
        mixed = [entry for entry in entries if isinstance(entry.starts[0], Interaction)]
        assert {entry.name for entry in mixed} == expected
        assert {entry.acts_on for entry in mixed} == {*ACTS_ON}
        assert pair not in {entry.name for entry in entries if entry not in mixed}


def test_of_two_causes_the_larger_one_does_not_displace_the_other_if_its_p_is_too_large(null):
    """The limit is a p of .01, to a twentieth of it; the smaller cause has a p of .001."""
    u, v = places(null["position_m"]), places(null["relative_humidity_pct"])
    state = state_of(null.assign(adhesion=null["adhesion"] * np.exp(0.1 * u + 0.08 * v)))
    columns = ("position_m", "relative_humidity_pct")
    entries = [
        line
        for column in columns
        for line in column_entries(Covariate, column, state.setting.problem)[:1]
    ]
    scores = screen([([null_of(state.fitted)], entries)], 0)
    for p, taken in ((0.0105, "relative_humidity_pct"), (0.0095, "position_m")):
        told = [
            score._replace(p=p if score.entry.covariates == ("position_m",) else 0.001)
            for score in scores
        ]
        after = _next(state, told, 0.01, 0, 0)
        (effect,) = after.accepted
        assert effect.covariates == (taken,)
        decisions = {row.name.split(":")[1].split(" ")[0]: row.decision for row in after.ranking}
        (other,) = {*columns} - {taken}
        assert decisions[taken] == "accepted"
        # One whose p is too large is not said to explain less: here it explains more.
        assert decisions[other] == ("not significant" if p > 0.01 else "explains less")
