"""Independent blocks of points, each over the whole slip range, on one rail or several."""

from adhesion_jax.errors import InputError
from adhesion_jax.options import BlockCount, Rail
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.course import Apart
from adhesion_jax.scenarios.excitation import Sweep
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import RailProcess, steady
from adhesion_jax.scenarios.rails import HE2018, RAILS


def single(rail: Rail = "dry", sweep: Sweep = Sweep(), noise: Noise = Noise()) -> Scenario:
    """One block of 500 points, slip 0 to 0.2, on one rail (dry)."""
    return Scenario(steady(RAILS, rail), sweep, noise, Apart(sweep.points), HE2018)


def coloured(
    rail: Rail = "dry", sweep: Sweep = Sweep(), noise: Noise = Noise(autocorrelation=0.8)
) -> Scenario:
    """As single, but neighbouring points share their noise (first-order autoregressive, 0.8).

    The noise of a point is as large as in single, and its time constant 4.5 samples. A method that
    takes it as white loses at most a per cent or two of its accuracy; but it assumes nine times the
    information that the points hold, so that its standard errors are a third of the true ones.
    """
    return single(rail, sweep, noise)


def he2018_blocks(
    blocks: BlockCount = 12, sweep: Sweep = Sweep(), noise: Noise = Noise()
) -> Scenario:
    """Blocks of 500 points, slip 0 to 0.2, dry, common and wet rail in turn (He Exp. 2 and 3)."""
    if blocks < 6:
        raise InputError(
            f"--blocks {blocks} is too few for --scenario he2018-blocks; "
            "each of its three rails needs two blocks, so at least 6."
        )
    order = tuple(RAILS)
    names = tuple(order[3 * block // blocks] for block in range(blocks))
    rails = RailProcess(names, tuple(RAILS[name] for name in names))
    return Scenario(rails, sweep, noise, Apart(sweep.points, blocks), HE2018)
