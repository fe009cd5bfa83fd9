"""A scenario: a rail, an excitation and noise, of which it draws records and knows the truth."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Curve, free_values
from adhesion_jax.metrics.information import bound_of_information, quantity_names, true_quantities
from adhesion_jax.records import Known, Record
from adhesion_jax.scenarios.course import Course, Figure, Tables
from adhesion_jax.scenarios.excitation import Excitation
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import RailProcess


class Scenario(eqx.Module):
    """Draws runs of slip and adhesion: mu = law(slip) + noise at every sample.

    `course` says how the samples come in blocks, `known` what an identifier is told.
    """

    rail: RailProcess
    excitation: Excitation
    noise: Noise
    course: Course
    known: Known

    @property
    def rails(self) -> tuple[str, ...]:
        """The name of the rail at the end of each block."""
        return self.rail.names

    @property
    def run_axes(self) -> Any:
        return self.excitation.axes

    def draw(self, key: PRNGKeyArray) -> Record:
        """All the blocks of one run: arrays [blocks, points]."""
        excited, left = self.excitation.draw(key, self.course.shape)
        clean = self.rail.adhesion(excited.slip, excited.conditions)
        adhesion = clean + self.noise.draw(left, self.course.shape)
        slip, adhesion, conditions = jax.tree.map(
            self.course.blocks_of, (excited.measured, adhesion, excited.conditions)
        )
        return Record(slip, adhesion, *self.course.seen(), conditions)

    def quantities(self) -> Mapping[str, np.ndarray]:
        """The true value of each quantity at the end of each block, arrays [blocks].

        Of a curve of another form than the one assumed these are the quantities of its peak.
        """
        if self.known.asked == ("slope",):
            return {"slope": self._slopes()}
        found = true_quantities(self._curve(self.course.ends), self._of_truth())
        return {name: found[name] for name in self._names()}

    def bound(self, record: Record) -> Float[Array, "blocks values"]:
        """Cramer-Rao bound of `quantities`, [blocks, values]; NaN where there is none.

        It is the bound for the last `support` points of one run up to each block, conditions and
        effects known; a method that uses more points may come below it. Of a rail that drifts it is
        the posterior bound of a method that is told the mean square of the steps that the
        parameters take, and of the changes of these, and no more of their path. Noise of the slip
        counts by the noise of adhesion that it is to first order; beside noise with a memory it is
        taken as told. Where every sample asks for another slope there is none.
        """
        names = self._names()
        if "slope" in names:
            return jnp.full((len(self.rails), len(names)), jnp.nan)
        ends, path = self._curve(self.course.ends), None
        by_values, slope = jax.vmap(self.rail.derivatives)(ends, record.slip, record.conditions)
        if self.rail.drifts:  # every point is a block of its own
            curves = self._curve(self.course.blocks_of)
            of_point = jax.vmap(jax.vmap(self.rail.derivatives))
            alone = jax.tree.map(lambda x: x[..., None], (record.slip, record.conditions))
            by_values, slope = of_point(curves, *alone)
            by_values, slope = jnp.swapaxes(by_values[..., 0], 1, 2), slope[..., 0]
            path = jax.vmap(jax.vmap(free_values))(curves)
        slip_noise, noise = self.excitation.slip_noise, self.noise
        if slip_noise and not noise.autocorrelation:
            spread = jnp.hypot(noise.sigma, slope * slip_noise)
            by_values = by_values * (noise.sigma / spread)[:, None]
        information = self.course.information(by_values, record.mask, noise, self.rails, path)
        bound = jax.vmap(bound_of_information, (0, 0, None, None))(
            ends, information, self.noise.sigma, self._of_truth()
        )
        return bound[:, -len(names) :]

    def support(self) -> np.ndarray:
        """The number of points that an estimate after each block can use, [blocks]."""
        return self.course.support(self.rails)

    def tables(self) -> Tables:
        """The rows of each table that is reported: the name of a table to its groups."""
        return self.course.tables(self.rails)

    def figures(self) -> list[Figure]:
        """What is drawn over the blocks of a run."""
        drift = [Figure("drift")] if self.rail.drifts else []
        return [*self.course.figures(self.excitation), *drift]

    def _names(self) -> tuple[str, ...]:
        if self.known.asked == ("slope",):
            return self.known.asked
        names = quantity_names(self.rail.curve)
        same = type(self.rail.curve) is type(self.known.curve)
        return names if same else names[len(self.rail.curve.free) :]

    def _of_truth(self) -> Known:
        """What is known, with the conditions of the peak that nobody measures."""
        conditions = {**self.known.conditions, **self.rail.conditions}
        return dataclasses.replace(self.known, conditions=conditions)

    def _curve(self, of_run: Callable[[Array], Array]) -> Curve:
        """The curve whose parameters are what `of_run` has of those along a run."""
        found: Curve = jax.tree.map(
            lambda value: of_run(jnp.broadcast_to(value, self.course.shape)), self.rail.curve
        )
        return found

    def _slopes(self) -> np.ndarray:
        """The slopes d mu/d v_s in s/m at the ends of the blocks; all runs have the same slips."""
        excited, _ = self.excitation.draw(jax.random.key(0), self.course.shape)
        slip = self.course.ends(excited.slip)
        slopes = jax.vmap(jax.grad(lambda slip: self.rail.adhesion(slip, {})))(slip)
        return np.asarray(slopes) / float(self.rail.conditions["vehicle_speed_mps"])
