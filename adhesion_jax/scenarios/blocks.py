"""Independent blocks of points, each over the whole slip range, on one rail or several."""

import dataclasses

from adhesion_jax.errors import InputError
from adhesion_jax.options import BlockCount, Rail, Told, Truth
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.course import Apart
from adhesion_jax.scenarios.excitation import Sweep
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import RailProcess, steady
from adhesion_jax.scenarios.rails import HE2018, RAILS, as_unknown, form_of, told_of


def single(
    rail: Rail = "dry",
    truth: Truth = "burckhardt",
    told: Told = "burckhardt",
    sweep: Sweep = Sweep(),
    noise: Noise = Noise(),
) -> Scenario:
    """One block of 500 points, slip 0 to 0.2, on one rail (dry).

    Where another form of curve is assumed than the rail has, the parameters of the assumed curve
    have no true values; the quantities of the peak have. Their bound is that of a method that
    assumes the true curve with its free parameters unknown, and holds for estimates without bias.
    The estimate of a curve with fewer parameters may come below it if its bias happens to be small.
    """
    form = form_of(truth)
    process = steady(form.rails, rail)
    known = told_of(told, truth, rail)
    law = as_unknown(process.curve, known)
    process = dataclasses.replace(process, law=law, conditions=form.conditions)
    return Scenario(process, sweep, noise, Apart(sweep.points), known)


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
