"""Columns that stand still within runs and hide each other: tested as one, named one by one."""

from itertools import combinations

import numpy as np
import pytest
from discovery_campaigns import alone, campaign, curve, levels, noise, seen, state_of
from scipy import stats

from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import library_of
from adhesion_jax.discovery.search.probes import directions_of, null_of
from adhesion_jax.discovery.search.screening import FLIPS, adjusted, orthonormal, signed
from adhesion_jax.discovery.search.selection import search
from adhesion_jax.effects import Covariate

FACTORS = ("oil", "load", "warm")


@pytest.fixture(scope="module")
def designed():
    """Three factors of two levels in all combinations, and two columns beside them."""
    draw = np.random.default_rng(7)
    table = campaign(draw)
    cell = draw.permutation(np.arange(20) % 8)[table["run"]]
    for bit, name in enumerate(FACTORS):
        table[name] = 1.0 * (cell >> bit & 1)
    return table.drop(columns="place")


@pytest.mark.long
def test_three_factors_of_a_design_are_each_named(designed):
    draw = np.random.default_rng(8)
    level = np.exp(sum(0.03 * (2 * designed[name] - 1) for name in FACTORS))
    made = curve(designed["slip_ratio"]) * level * levels(draw, designed, 0.004) + noise(draw)
    state = state_of(designed.assign(adhesion=made))
    found = search(state, library_of(state.setting.problem), 0, lambda *_: None)
    assert {effect.covariates for effect in found.accepted} == {(name,) for name in FACTORS}
    assert all(effect.p == 1 / (1 + FLIPS) for effect in found.accepted)
    # None of them alone is significant beside what the others do.
    first = [row for row in found.ranking if row.round == 0 and "beside others" not in row.name]
    assert min(row.p_adjusted for row in first) > rules.SIGNIFICANT
    # The factor from one level to the other is exp(.06).
    for effect in found.accepted:
        (line,) = effect.parts
        assert float(line.k / line.scale) == pytest.approx(0.06, abs=0.01)


@pytest.mark.long
def test_where_levels_scatter_alone_the_best_of_all_choices_is_as_rarely_significant_as_it_says(
    designed,
):
    """Of 200 draws, but for one chance in 1000."""
    draw = np.random.default_rng(9)
    clean = curve(designed["slip_ratio"])
    null = null_of(alone(designed.assign(adhesion=clean * levels(draw, designed) + noise(draw))))
    columns = {name: designed[name].to_numpy() for name in (*FACTORS, "old")}
    testable, flat = directions_of(null, Covariate.starts(columns))
    assert testable.all()
    sets = [some for size in (2, 3) for some in combinations(range(4), size)]
    blocks = [orthonormal(flat[:, list(some)]) for some in sets]
    found = []
    for seed in range(200):
        now = seen(null, clean * levels(draw, designed) + noise(draw))
        z, largest = signed(now, blocks, seed)
        found.append(adjusted(float(z.max()), largest, 20))
    for level in (0.01, 0.05, 0.2):
        assert np.sum(np.array(found) <= level) <= stats.binom.isf(1e-3, 200, level)
    assert np.mean(np.array(found) <= 0.2) > 0.1
