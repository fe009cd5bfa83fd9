"""Why an estimate cannot be trusted, in words."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identifier_cases import GRADIENT, RUNS, programs
from lanes import lanes

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.identifiers import IDENTIFIERS, Status
from adhesion_jax.records import SHARED_SLIP, Known, Record


def fit_to(identifier, known, slip, adhesion):
    """One record, as a batch of equal runs: the program that the scenario `single` has."""
    slip = jnp.asarray(slip)[None]
    adhesion = jnp.broadcast_to(jnp.asarray(adhesion), (RUNS, *slip.shape))
    every = jnp.ones(slip.shape, dtype=bool)
    record = Record(slip, adhesion, every, every, {})
    keys = jax.random.split(jax.random.key(0), RUNS)
    estimate = programs(SHARED_SLIP).identify(identifier, known, record, keys)
    return jax.tree.map(lambda leaf: np.asarray(leaf)[0, 0], estimate)


SLIP = np.linspace(0.0, 0.5, 120)
WIDE = Known(Burckhardt(0.3, 5.0, 0.1), jnp.array([0.01, 0.2, 0.001]), jnp.array([2.0, 50.0, 3.0]))


@pytest.mark.parametrize(
    "name", lanes(["ml-exact", "ml-de-robust", "lm-jaxopt", "lm-optimistix"], always=2, long=2)
)
def test_the_status_says_why_an_estimate_cannot_be_trusted(name):
    identifier = IDENTIFIERS[name]
    rng = np.random.default_rng(1)
    noise = 0.001 * rng.normal(size=SLIP.size)

    def status(adhesion, known=WIDE):
        estimate = fit_to(identifier, known, SLIP, adhesion)
        assert all(np.isfinite(value) for value in estimate.values.values())
        return Status(int(estimate.status))

    def burckhardt(c1, c2, c3):
        return c1 * (1 - np.exp(-c2 * SLIP)) - c3 * SLIP + noise

    assert status(burckhardt(0.5, 20.0, 0.2)) == Status.TRUSTED
    # The peak lies at ln(.6 * 1.5 / .02) / 1.5 = 2.5.
    assert status(burckhardt(0.6, 1.5, 0.02)) == Status.NO_PEAK
    # It falls from the start.
    assert status(-0.5 * SLIP + noise) == Status.INADMISSIBLE
    tight = Known(WIDE.curve, jnp.array([0.01, 0.2, 0.3]), WIDE.upper)
    on_box = status(burckhardt(0.5, 20.0, 0.1), tight)
    assert on_box == Status.ON_BOX or (on_box == Status.NOT_CONVERGED and name in GRADIENT)


def test_of_two_reasons_the_graver_one_is_told():
    """The peak at slip 2.5 lies beyond the largest slip asked for, and c3 on its bound."""
    adhesion = 0.6 * (1 - np.exp(-1.5 * SLIP)) - 0.02 * SLIP
    held = Known(WIDE.curve, jnp.array([0.01, 0.2, 0.03]), WIDE.upper)
    free = Known(WIDE.curve, WIDE.lower, WIDE.upper, slip_limit=3.0)
    both = Known(WIDE.curve, jnp.array([0.01, 0.2, 0.03]), WIDE.upper, slip_limit=3.0)
    found = {
        name: fit_to(IDENTIFIERS["ml-exact"], known, SLIP, adhesion)
        for name, known in (("no peak, on box", held), ("neither", free), ("on box", both))
    }
    assert found["no peak, on box"].values["c3"] == pytest.approx(0.03)
    assert found["on box"].values["c3"] == pytest.approx(0.03)
    assert {name: Status(int(e.status)) for name, e in found.items()} == {
        "no peak, on box": Status.NO_PEAK,
        "neither": Status.TRUSTED,
        "on box": Status.ON_BOX,
    }
    assert found["neither"].values["slip_opt"] == pytest.approx(np.log(0.6 * 1.5 / 0.02) / 1.5)


def test_statuses_are_sentences():
    for status in Status:
        assert status.sentence.endswith(".")
    assert len({status.sentence for status in Status}) == len(Status)
