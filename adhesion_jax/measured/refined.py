"""A curve fitted with the noise of measured runs, and its peak with all that is unknown of it."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.curves import Curve, Scalar, with_free_values
from adhesion_jax.measured.fit import box_share_to_parameters
from adhesion_jax.measured.noise import (
    MISFITS,
    Fixed,
    Noise,
    Products,
    RunNoise,
    estimated,
    inverse,
    left_out,
    misfit_functions,
    normal_equations,
    products_of,
    solve,
    wanted,
    whitened_sum,
)
from adhesion_jax.optim.box import on_bound

#: Noise and curve are estimated in turns, each with at most so many steps of the curve.
_TURNS, _STEPS = 4, 20

#: A fit under one noise ends where a step promises to lower half the deviance by less than this.
_NEAR = 1e-7

#: Number of slips of the grid on which the law is given and its peak is looked for.
_GRID = 513

#: Share of the mean square adhesion that is rounding and no noise.
_ROUNDING = 1e-20


class Points(NamedTuple):
    """The points of a record in stretches, [stretches, 1 + length]; see `Segments`."""

    slip: Float[Array, "stretches points"]
    adhesion: Float[Array, "stretches points"]
    conditions: Mapping[str, Float[Array, "stretches points"]]
    valid: Bool[Array, "stretches points"]
    run: Int[Array, " stretches"]
    variance: Float[Array, "stretches points"]  # of the slip


class Refined(NamedTuple):
    """The fit of greatest likelihood under the noise of greatest restricted likelihood.

    The law is the curve and what it misses: f(s; theta) + sum_j b_j f(s; theta_0) phi_j(s), theta_0
    the least squares estimate.
    """

    parameters: Float[Array, " free"]
    covariance: Float[Array, "free free"]
    held: Bool[Array, " free"]  # on the bound, or without influence
    on_bound: Bool[Array, " free"]
    sigma: Float[Array, ""]
    autocorrelation: Float[Array, ""]
    run_scatter: Float[Array, ""]  # relative
    misfit: Float[Array, ""]  # root mean square over the points, relative
    slips: Float[Array, " grid"]
    law: Float[Array, " grid"]
    law_se: Float[Array, " grid"]
    slip_opt: Float[Array, ""]
    mu_max: Float[Array, ""]
    slip_opt_se: Float[Array, ""]  # NaN without a peak
    mu_max_se: Float[Array, ""]
    found: Bool[Array, ""]  # whether the law has a peak within the range looked at
    degrees: Float[Array, ""]  # of freedom of the standard errors of the peak
    effective: Float[Array, ""]  # independent samples that would tell as much of mu_max
    left_out: Float[Array, " runs"]  # log density of each run, given the others
    products: Products  # at the fit
    whole: Float[Array, "wanted wanted"]  # covariance of share and misfit
    noise: Noise
    converged: Bool[Array, ""]


class _State(NamedTuple):
    share: Float[Array, " free"]
    found: Products
    noise: Noise
    trial: Float[Array, " free"]
    damping: Float[Array, ""]
    new: Bool[Array, ""]  # the trial is the share itself, under another noise
    turns: Int[Array, ""]
    steps: Int[Array, ""]
    promised: Float[Array, ""]


def refined(
    curve: Curve,
    start: Float[Array, " free"],
    felt: Bool[Array, " free"],
    points: Points,
    counts: tuple[Float[Array, " runs"], Float[Array, " runs"]],
    ordered: Bool[Array, ""],
    several: Bool[Array, ""],
    medians: Mapping[str, Scalar],
    slip_limit: Scalar,
) -> Refined:
    """The curve within its box, from the shares of the box of a fit that is near.

    `felt` says which parameters have an influence; `counts` are the points of each run and those
    with a predecessor. Where the slip has a variance, a point weighs less by the slope of the curve
    there.
    """
    count = start.size
    fixed = Fixed(felt, ordered, several)

    def prediction(share: Array, slip: Array, conditions: Mapping[str, Array]) -> Array:
        return with_free_values(curve, box_share_to_parameters(curve, share))(slip, conditions)

    peak = with_free_values(curve, box_share_to_parameters(curve, start)).peak(medians, slip_limit)
    largest = jnp.max(jnp.where(points.valid, jnp.abs(points.slip), 0.0))
    middle = jnp.where(peak.found, peak.slip, 0.2 * largest)
    total = jnp.sum(counts[0])
    square = jnp.sum(jnp.where(points.valid[:, 1:], points.adhesion[:, 1:], 0.0) ** 2) / total
    floor = _ROUNDING * square

    def products(share: Array, variance: Array) -> Products:
        def of_stretch(one: Points) -> Array:
            slopes = jax.jacfwd(lambda share: prediction(share, one.slip, one.conditions))(share)
            level, steepness = jax.jvp(
                lambda slip: prediction(start, slip, one.conditions),
                (one.slip,),
                (jnp.ones_like(one.slip),),
            )
            missed = misfit_functions(one.slip, middle, largest) * level[:, None]
            error = one.adhesion - prediction(share, one.slip, one.conditions)
            columns = jnp.column_stack([slopes, missed, level, error])
            weight = 1 / jnp.sqrt(1 + steepness**2 * one.variance / variance)
            return products_of(jnp.where(one.valid, weight, 0.0)[:, None] * columns, one.valid)

        of_each = jax.lax.map(of_stretch, points)
        sums = jax.ops.segment_sum(of_each, points.run, counts[0].size)
        return Products(jnp.moveaxis(sums, 1, 0), *counts)

    def deviance(found: Products, shape: RunNoise, free: Array) -> tuple[Array, Array, Array]:
        white, _ = whitened_sum(jnp.sum(found.sums, axis=1), found.sums[:, :, -2], shape)
        matrix, right = normal_equations(white, shape, free)
        return white[-1, -1], matrix, right

    def of_curve(found: Products, shape: RunNoise) -> Array:
        """The deviance with the best misfit, in units of sigma^2."""
        error, matrix, right = deviance(found, shape, jnp.zeros(count, bool))
        return error - right @ solve(matrix, right)

    def proposal(
        share: Array, found: Products, noise: Noise, damping: Array
    ) -> tuple[Array, Array]:
        """The step of Levenberg and Marquardt within the box, and what it promises."""
        _, matrix, right = deviance(found, noise.shape, felt)
        growth = jnp.where(jnp.arange(count + MISFITS) < count, 1 + damping, 1.0)
        matrix = matrix * jnp.diag(growth) + matrix * (1 - jnp.eye(growth.size))
        step = solve(matrix, right)[:count]
        for _ in range(2):
            out = ((share <= 0) & (step < 0)) | ((share >= 1) & (step > 0))
            held = jnp.concatenate([felt & ~out, jnp.ones(MISFITS, bool)])
            some = jnp.where(held[:, None] & held, matrix, jnp.eye(held.size))
            step = jnp.where(held, solve(some, jnp.where(held, right, 0.0)), 0.0)[:count]
        new = jnp.clip(share + step, 0.0, 1.0)
        return new, jnp.abs((new - share) @ right[:count]) / noise.variance

    def body(state: _State) -> _State:
        there = products(state.trial, state.noise.variance)
        shape = state.noise.shape
        better = state.new | (of_curve(there, shape) <= of_curve(state.found, shape))
        share, found = jax.tree.map(
            lambda a, b: jnp.where(better, a, b), (state.trial, there), (state.share, state.found)
        )
        damping = jnp.where(better, state.damping * 0.2, jnp.maximum(8 * state.damping, 1e-4))
        settled = (state.promised <= _NEAR) | (state.steps >= _STEPS) | (state.turns == 0)
        noise = jax.lax.cond(
            settled, lambda: estimated(found, fixed, floor), lambda: state.noise
        )
        damping = jnp.where(settled, 1e-3, damping)
        trial, promised = proposal(share, found, noise, damping)
        return _State(
            share,
            found,
            noise,
            jnp.where(settled, share, trial),
            damping,
            settled,
            state.turns + settled,
            jnp.where(settled, 0, state.steps + 1),
            jnp.where(settled, jnp.inf, promised),
        )

    columns = count + MISFITS + 2
    none = Products(jnp.zeros((4, counts[0].size, columns, columns)), *counts)
    white = RunNoise(jnp.array(0.0), jnp.array(0.0), jnp.array(0.0))
    state = jax.lax.while_loop(
        lambda state: state.turns <= _TURNS,
        body,
        _State(
            start,
            none,
            Noise(white, square),
            start,
            jnp.array(1e-3),
            jnp.array(True),
            jnp.array(0),
            jnp.array(0),
            jnp.array(jnp.inf),
        ),
    )
    share, found, noise = state.share, state.found, state.noise
    shape, variance = noise
    bound = felt & on_bound(share, jnp.zeros(count), jnp.ones(count))
    inside = felt & ~bound

    def spread(shape: RunNoise) -> Array:
        _, matrix, _ = deviance(found, shape, inside)
        used = wanted(shape, inside)
        return jnp.where(used[:, None] & used, variance * inverse(matrix), 0.0)

    whole = spread(shape)
    _, matrix, right = deviance(found, shape, inside)
    best = solve(matrix, right)
    missed = jnp.where(shape.misfit > 0, best[count:], 0.0)

    # Denser where the curve rises: s/(s + middle) in even steps.
    even = jnp.linspace(0.0, 1.0, _GRID) * slip_limit / (slip_limit + middle)
    slips = even * middle / (1 - even)
    first = prediction(start, slips, medians)
    more = misfit_functions(slips, middle, largest) * first[:, None]
    law = prediction(share, slips, medians) + more @ missed
    slopes = jax.jacfwd(lambda share: prediction(share, slips, medians))(share)
    slopes = jnp.hstack([jnp.where(felt, slopes, 0.0), more])
    top = jnp.argmax(law)
    there = (top > 0) & (top < _GRID - 1)
    near = jnp.clip(top, 1, _GRID - 2) + jnp.arange(-1, 2)
    at, weights, tilt = _vertex(slips[near], law[near])
    along = jnp.where(there, weights @ slopes[near], slopes[top])
    across = tilt @ slopes[near]
    of_law = along @ whole @ along

    # Shares of the variance that the levels of the runs and the misfit have, each known no better
    # than by its own number of degrees of freedom.
    without = jnp.stack(
        [
            along @ spread(shape._replace(scatter=jnp.array(0.0))) @ along,
            along @ spread(shape._replace(misfit=jnp.array(0.0))) @ along,
        ]
    )
    parts = jnp.clip(1 - without / of_law, 0.0, 1.0)
    rest = 1 - jnp.minimum(jnp.sum(parts), 1.0)
    r = shape.autocorrelation
    independent = jnp.maximum(total * (1 - r) / (1 + r) - jnp.sum(inside), 1.0)
    runs = jnp.maximum(jnp.sum(counts[0] > 0) - 1.0, 1.0)
    degrees = 1 / (parts[0] ** 2 / runs + parts[1] ** 2 / MISFITS + rest**2 / independent)
    stretch = jax.jacfwd(lambda share: box_share_to_parameters(curve, share))(share)
    sizes = jnp.diagonal(jnp.sum(found.sums[:2], axis=(0, 1)))
    rough = jnp.arange(1.0, MISFITS + 1) ** -3
    misfit = jnp.sqrt(
        shape.misfit * variance * (sizes[count : count + MISFITS] @ rough) / sizes[-2]
    )
    return Refined(
        box_share_to_parameters(curve, share),
        stretch @ whole[:count, :count] @ stretch.T,
        ~inside,
        bound,
        jnp.sqrt(variance),
        r,
        jnp.sqrt(shape.scatter * variance),
        misfit,
        slips,
        law,
        jnp.sqrt(jnp.einsum("gi,ij,gj->g", slopes, whole, slopes)),
        jnp.where(there, at, slips[top]),
        jnp.where(there, weights @ law[near], law[top]),
        jnp.where(there, jnp.sqrt(across @ whole @ across), jnp.nan),
        jnp.sqrt(of_law),
        there & (law[top] > 0),
        degrees,
        total * (along @ spread(white) @ along) / of_law,
        left_out(found, noise, inside),
        found,
        whole,
        noise,
        jnp.all(jnp.isfinite(whole)),
    )


def _vertex(
    slips: Float[Array, "3"], values: Float[Array, "3"]
) -> tuple[Float[Array, ""], Float[Array, "3"], Float[Array, "3"]]:
    """Of the parabola through three points, its vertex, and the derivatives by the three values.

    First those of its largest value, which also give that value, then those of its place.
    """
    a, b, c = slips
    square = jnp.array([1 / ((a - b) * (a - c)), 1 / ((b - a) * (b - c)), 1 / ((c - a) * (c - b))])
    slope = -square * jnp.array([b + c, a + c, a + b])
    bend = 2 * square @ values
    at = -(slope @ values) / bend
    weights = square * jnp.array([(at - b) * (at - c), (at - a) * (at - c), (at - a) * (at - b)])
    return at, weights, -(2 * square * at + slope) / bend
