"""The noise of measured runs, estimated together with a curve by restricted maximum likelihood.

The adhesion of a run, y, [points], is taken as

    y = f(s; theta) + f(s) sum_j b_j phi_j(s) + f(s) a + e,

with the curve f, what the curve misses as a smooth function of the slip (b_j normal of variance
misfit^2/j^3), a level of the run (a normal, of standard deviation run_scatter) and noise e of
standard deviation sigma, whose neighbours in a run have the correlation `autocorrelation`.

With the curve linear in theta about its fit, the likelihood needs no more than sums of products of
columns over the points of each run: of the derivatives, of f phi, of f, and of the residual.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

#: Number of functions of the slip that make up what a curve misses.
MISFITS = 8

#: Largest autocorrelation that is considered: noise beyond it would be a drift.
_MOST_CORRELATED = 0.995

#: Largest variance of the levels of the runs, and of the misfit, relative to that of the noise.
_LARGEST_RATIO = 1e8

#: Places along each of autocorrelation, run scatter and misfit: of a first grid, and of finer ones
#: about the best place so far, each spanning half the one before.
_FIRST, _FINER, _TURNS = 9, 5, 8

#: Share of the information about a parameter that is added to it against rounding.
_ROUNDING = 1e-12


class RunNoise(NamedTuple):
    """The parameters of the noise; variances relative to sigma^2."""

    autocorrelation: Float[Array, ""]
    scatter: Float[Array, ""]  # (run_scatter/sigma)^2
    misfit: Float[Array, ""]  # (misfit/sigma)^2


class Products(NamedTuple):
    """Sums over the points of each run of products of columns, [4, runs, columns, columns].

    First axis, the points that are summed over: those without a predecessor in their run; those
    with one; the latter times their predecessors, both ways; the predecessors. The columns are the
    derivatives, the functions of the misfit, the level f, and the residual.
    """

    sums: Float[Array, "4 runs columns columns"]
    points: Float[Array, " runs"]
    linked: Float[Array, " runs"]  # points with a predecessor


class Fixed(NamedTuple):
    """What of the noise may be estimated, and which derivatives are free."""

    free: Bool[Array, " derivatives"]
    ordered: Bool[Array, ""]  # the points of a run are in the order of time
    several: Bool[Array, ""]  # there are runs, whose levels may differ


class Noise(NamedTuple):
    """The noise of greatest restricted likelihood."""

    shape: RunNoise
    variance: Float[Array, ""]  # sigma^2


def products_of(
    columns: Float[Array, "1+points columns"], valid: Bool[Array, " 1+points"]
) -> Float[Array, "4 columns columns"]:
    """The products over one stretch of a run, led in by the last point of the stretch before."""
    now, before = columns[1:], columns[:-1]
    here, led = valid[1:], valid[1:] & valid[:-1]
    alone = jnp.where((here & ~led)[:, None], now, 0.0)
    now, before = jnp.where(led[:, None], now, 0.0), jnp.where(led[:, None], before, 0.0)
    crossed = now.T @ before
    return jnp.stack([alone.T @ alone, now.T @ now, crossed + crossed.T, before.T @ before])


def whitened(
    found: Products, noise: RunNoise
) -> tuple[Float[Array, "runs columns columns"], Float[Array, " runs"]]:
    """The products of each run under the inverse of its noise, in units of sigma.

    Also the log determinants that the level of the run adds, halved. The misfit is no part of this
    noise: its functions are columns.
    """
    one = _without_correlation(found.sums, noise)
    level = one[:, -2]
    size = 1 + noise.scatter * level[:, -2]
    less = noise.scatter * level[:, :, None] * level[:, None, :] / size[:, None, None]
    return one - less, 0.5 * jnp.log(size)


def whitened_sum(
    total: Float[Array, "4 columns columns"],
    levels: Float[Array, "4 runs columns"],
    noise: RunNoise,
) -> tuple[Float[Array, "columns columns"], Float[Array, ""]]:
    """The sums over the runs of `whitened`, from those of the products and the rows of the level."""
    level = _without_correlation(levels, noise)
    size = 1 + noise.scatter * level[:, -2]
    less = (level * (noise.scatter / size)[:, None]).T @ level
    return _without_correlation(total, noise) - less, 0.5 * jnp.sum(jnp.log(size))


def _without_correlation(sums: Float[Array, "4 *rest"], noise: RunNoise) -> Float[Array, "*rest"]:
    alone, now, crossed, before = sums
    r = noise.autocorrelation
    return alone + (now - r * crossed + r**2 * before) / (1 - r**2)


def normal_equations(
    white: Float[Array, "columns columns"], noise: RunNoise, free: Bool[Array, " derivatives"]
) -> tuple[Float[Array, "wanted wanted"], Float[Array, " wanted"]]:
    """Matrix and right hand side for derivatives and misfit together.

    Rows and columns of derivatives that are not free, and those of a misfit that is none, are those
    of the identity.
    """
    used = wanted(noise, free)
    matrix = jnp.where(used[:, None] & used, white[: used.size, : used.size], 0.0)
    return (
        matrix + jnp.diag(jnp.where(used, prior(noise, free.size), 1.0)),
        jnp.where(used, white[: used.size, -1], 0.0),
    )


def wanted(noise: RunNoise, free: Bool[Array, " derivatives"]) -> Bool[Array, " wanted"]:
    """Which derivatives and functions of the misfit are estimated."""
    return jnp.concatenate([free, jnp.full(MISFITS, noise.misfit > 0)])


def prior(noise: RunNoise, derivatives: int) -> Float[Array, " wanted"]:
    """Inverse variances in units of sigma^-2: none of the derivatives, of the misfit j^3/misfit."""
    rough = jnp.arange(1.0, MISFITS + 1) ** 3 / jnp.where(noise.misfit > 0, noise.misfit, 1.0)
    return jnp.concatenate([jnp.zeros(derivatives), rough])


def misfit_functions(
    slip: Float[Array, "*shape"], middle: Float[Array, ""], largest: Float[Array, ""]
) -> Float[Array, "*shape misfits"]:
    """cos(pi j u), j from 1, of u = s/(s + middle) relative to that of the largest slip."""
    size = jnp.minimum(jnp.abs(slip), largest)
    share = size / (size + middle) * (largest + middle) / largest
    return jnp.cos(jnp.pi * jnp.arange(1, MISFITS + 1) * share[..., None])


def estimated(found: Products, fixed: Fixed, floor: Float[Array, ""]) -> Noise:
    """The noise of greatest restricted likelihood, by grids that close in on it.

    An autocorrelation is estimated only if the points of the runs are in the order of time, the
    scatter of the runs only where there are several. `floor` is the least variance that is taken
    for noise and not for the rounding of numbers. Patterson and Thompson 1971, Biometrika
    58:545-554; Harville 1977, J. Am. Stat. Assoc. 72:320-338.
    """
    total, levels = jnp.sum(found.sums, axis=1), found.sums[:, :, -2]
    count = fixed.free.size
    sizes = jnp.diagonal(total[0] + total[1])
    of_level = found.points.size / sizes[-2]
    of_misfit = 1 / jnp.mean(sizes[count : count + MISFITS])
    points, linked = jnp.sum(found.points), jnp.sum(found.linked)
    degrees = jnp.maximum(points - jnp.sum(fixed.free), 1.0)

    def at(place: Float[Array, "3"]) -> RunNoise:
        ratio = jnp.expm1(place[1:] * jnp.log1p(_LARGEST_RATIO * 1e3)) / 1e3
        r = _MOST_CORRELATED * jnp.sqrt(place[0])
        return RunNoise(r, ratio[0] * of_level, ratio[1] * of_misfit)

    def loss(noise: RunNoise) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """Minus the restricted log likelihood less a constant, and the best sigma^2."""
        white, growth = whitened_sum(total, levels, noise)
        matrix, right = normal_equations(white, noise, fixed.free)
        even, scale = _scaled(matrix)
        factor = jnp.linalg.cholesky(even)
        along = jax.scipy.linalg.solve_triangular(factor, right * scale, lower=True)
        left = jnp.maximum(white[-1, -1] - along @ along, 0.0) / degrees + floor
        rough = jnp.where(noise.misfit > 0, jnp.log(prior(noise, count)[count:]), 0.0)
        determinants = (
            jnp.sum(jnp.log(jnp.diagonal(factor)))
            - jnp.sum(jnp.log(scale))
            - 0.5 * jnp.sum(rough)
            + 0.5 * linked * jnp.log1p(-(noise.autocorrelation**2))
            + growth
        )
        value = 0.5 * degrees * jnp.log(left) + determinants
        return jnp.where(jnp.isfinite(value), value, jnp.inf), left

    # What the points tell grows with their number: an autocorrelation, with that of a run.
    highest = jnp.array([1.0, 1.0, 0.75]) * jnp.array([fixed.ordered, fixed.several, True])

    def best_of(centre: Float[Array, "3"], reach: Float[Array, "3"], count: int) -> Array:
        steps = jnp.linspace(-1.0, 1.0, count)
        places = jnp.stack(jnp.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
        places = jnp.clip(centre + places * reach, 0.0, highest)
        return places[jnp.argmin(jax.lax.map(lambda place: loss(at(place))[0], places, batch_size=count**2))]

    def closer(turn: Int[Array, ""], best: Float[Array, "3"]) -> Float[Array, "3"]:
        return best_of(best, highest / (_FIRST - 1) * 0.5**turn, _FINER)

    first = best_of(highest / 2, highest / 2, _FIRST)
    noise = at(jax.lax.fori_loop(0, _TURNS, closer, first))
    return Noise(noise, loss(noise)[1])


def left_out(
    found: Products, noise: Noise, inside: Bool[Array, " derivatives"]
) -> Float[Array, " runs"]:
    """The log density of each run, given the fit to all others; the noise is that of all runs."""
    white, growth = whitened(found, noise.shape)
    total = jnp.sum(white, axis=0)
    used = wanted(noise.shape, inside)
    free = jnp.outer(used, used)
    correlated = 0.5 * found.linked * jnp.log1p(-(noise.shape.autocorrelation**2))
    usual = 0.5 * found.points * jnp.log(2 * jnp.pi * noise.variance) + correlated + growth

    def one(of_run: Float[Array, "columns columns"]) -> Float[Array, ""]:
        matrix, right = normal_equations(total - of_run, noise.shape, inside)
        own = jnp.where(free, of_run[: used.size, : used.size], 0.0)
        cross = jnp.where(used, of_run[: used.size, -1], 0.0)
        best = solve(matrix, right)
        square = of_run[-1, -1] - 2 * best @ cross + best @ own @ best
        gradient = cross - own @ best
        square -= gradient @ solve(matrix + own, gradient)
        logs = jnp.linalg.slogdet(matrix + own)[1] - jnp.linalg.slogdet(matrix)[1]
        return -0.5 * (square / noise.variance + logs)

    return jax.lax.map(one, white) - usual


def solve(matrix: Float[Array, "n n"], right: Float[Array, " n"]) -> Float[Array, " n"]:
    even, scale = _scaled(matrix)
    return jnp.linalg.solve(even, right * scale) * scale


def inverse(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    even, scale = _scaled(matrix)
    return jnp.linalg.inv(even) * scale[:, None] * scale


def _scaled(matrix: Float[Array, "n n"]) -> tuple[Float[Array, "n n"], Float[Array, " n"]]:
    """The matrix with a diagonal of ones, and the factors that make it so."""
    scale = 1 / jnp.sqrt(jnp.maximum(jnp.diagonal(matrix), 1e-300))
    return matrix * scale[:, None] * scale + _ROUNDING * jnp.eye(len(scale)), scale
