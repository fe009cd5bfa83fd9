"""Maximum likelihood by differential evolution: He et al. 2018, its ablations and a repair."""

import jax
import jax.numpy as jnp

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.base import Flag
from adhesion_jax.identifiers.curve_fit import FitState, OfLastRecord, evaluate, residual
from adhesion_jax.identifiers.ml_exact import burckhardt_sums, needs_burckhardt
from adhesion_jax.optim import differential_evolution as de
from adhesion_jax.optim.arrays import Value
from adhesion_jax.optim.variable_projection import sum_of_squares
from adhesion_jax.records import Known, Record

#: He et al. 2018, Table 2.
POPULATION, GENERATIONS, CROSSOVER = 20, 300, 0.6

#: The search stops when the population's log likelihoods differ by less than this.
_SPREAD = 1e-4


class DifferentialEvolutionMaximumLikelihood(OfLastRecord):
    """The likelihood searched by rand/1/bin over the box.

    The initial population has a share `local_share` around the previous estimate theta(k-1)
    with radius r (Eq. 16), the rest uniform over the box. The scale factor is
    F(k) = scale_low + scale_gain / (1 + exp(-10 |e| + 2)), at least `scale_least`, where |e| is
    the mean absolute innovation of the block under theta(k-1) (Eq. 17 has .3 and .8; the mean
    over the block is our reading of its innovation).
    """

    FITS_LAST_RECORD = True

    local_share: Scalar
    radius: Scalar
    scale_low: Scalar
    scale_gain: Scalar
    scale_least: Scalar = 0.0
    reflect: Flag = False

    def accepts(self, known: Known) -> str | None:
        return needs_burckhardt(known)

    def scale_factor(self, innovation: Value) -> Value:
        """F(k) for a mean absolute innovation |e|."""
        logistic = jax.nn.sigmoid(10 * innovation - 2)
        return jnp.maximum(self.scale_low + self.scale_gain * logistic, self.scale_least)

    def update(self, state: FitState, record: Record) -> FitState:
        known, previous = state.known, state.fit.parameters
        key, population_key, search_key = jax.random.split(state.key, 3)
        points = jnp.sum(record.mask)
        innovation = jnp.sum(jnp.abs(residual(known, record, previous))) / points
        settings = de.Settings(
            scale=self.scale_factor(innovation),
            crossover=jnp.asarray(CROSSOVER),
            reflect=jnp.asarray(self.reflect),
            tolerance=_SPREAD / points,
        )
        sums = burckhardt_sums(known, record)
        low, high = known.lower[1], known.upper[1]
        population = de.local_plus_uniform(
            population_key,
            previous,
            known.lower,
            known.upper,
            self.local_share,
            self.radius,
            self.reflect,
            POPULATION,
        )
        found = de.minimise(
            lambda x: sum_of_squares(sums, x[0], x[1], x[2], low, high),
            population,
            known.lower,
            known.upper,
            search_key,
            settings,
            GENERATIONS,
        )
        fit = evaluate(known, record, state.fit, found.x, found.evaluations, found.converged)
        return FitState(known, key, fit)


#: Random start and constant F (Experiment 2); Eq. 16 and Eq. 17 alone; both (Experiment 3); and
#: a variant that does not fail: half the population uniform, F at least .6, mirrored bounds.
ml_de = DifferentialEvolutionMaximumLikelihood(0.0, 0.1, 0.5, 0.0)
ml_de_eq16 = DifferentialEvolutionMaximumLikelihood(1.0, 0.1, 0.5, 0.0)
ml_de_eq17 = DifferentialEvolutionMaximumLikelihood(0.0, 0.1, 0.3, 0.8)
ml_de_he2018 = DifferentialEvolutionMaximumLikelihood(1.0, 0.1, 0.3, 0.8)
ml_de_robust = DifferentialEvolutionMaximumLikelihood(0.5, 0.05, 0.3, 0.8, 0.6, reflect=True)
