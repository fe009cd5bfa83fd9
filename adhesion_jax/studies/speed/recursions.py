"""Recursions over streams of samples: the identifiers, and the same in NumPy and in numba."""

import time
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.records import Known, Record, record_axes
from adhesion_jax.scenarios import Options
from adhesion_jax.scenarios.rails import KIENCKE_RAILS
from adhesion_jax.studies.speed.turns import Timed, absent, timed

UNIT = "samples"

_Pair = tuple[np.ndarray, np.ndarray]

#: Each part with the identifiers in it and their peer, which is NumPy over all the runs at once.
RECURSIONS, PROGRAMS = "recursions", "quadratic programs"
_PARTS = {
    RECURSIONS: ("numpy-rls", ("rls-kiencke", "rls-kiencke-variable")),
    PROGRAMS: ("numpy-qp", ("qp-qian2024-1", "qp-qian2024-2", "qp-bias-compensated")),
}
RUNS, SAMPLES = 10_000, 500

#: Where the recursions start, and the weight of that start in the quadratic programs.
_START, _RIDGE = (100.0, 50.0), 1e-10

#: Number of runs of a group, whose states fit into the cache; NumPy, whose calls are slow, is
#: fastest with all runs at once.
_GROUP = 250

#: Timed programs are compiled with full optimisation, whatever the flags of the environment.
_OPTIMISED: dict[str, str | bool] = {"xla_backend_optimization_level": "3"}


def entries(seed: int) -> Mapping[tuple[str, str], Mapping[str, Timed]]:
    """What is timed of recursive least squares and of the quadratic programs, by part and peer."""
    known = build_scenario(Config("qian2024", options=Options(points=SAMPLES))).known
    random = np.random.default_rng(seed)
    slip = random.uniform(0.0, 0.2, (SAMPLES, RUNS))
    clean = np.asarray(KIENCKE_RAILS["dry"](jnp.asarray(slip), {}))
    adhesion = clean + random.normal(0.0, 0.01, slip.shape)
    every = jnp.ones(SAMPLES, dtype=bool)
    groups = [
        Record(jnp.asarray(slip[:, runs]), jnp.asarray(adhesion[:, runs]), every, every, {})
        for runs in np.split(np.arange(RUNS), range(_GROUP, RUNS, _GROUP))
    ]
    box = np.asarray(known.lower), np.asarray(known.upper)
    peers: Mapping[str, Callable[[], object]] = {
        RECURSIONS: lambda: numpy_recursion(slip, adhesion),
        PROGRAMS: lambda: numpy_program(slip, adhesion, box),
    }
    found: dict[tuple[str, str], dict[str, Timed]] = {}
    for part, (peer, names) in _PARTS.items():
        of_part = {peer: Timed(timed(peers[part], slip.size))}
        for name in names:
            function, seconds = _over_runs(IDENTIFIERS[name], known, groups)
            of_part[name] = Timed(timed(function, slip.size), "", seconds)
        found[part, peer] = of_part
    missing = absent("numba")
    found[RECURSIONS, _PARTS[RECURSIONS][0]]["numba-rls"] = (
        Timed(None, missing)
        if missing
        else Timed(timed(_numba_recursion(slip, adhesion), slip.size))
    )
    return found


def _over_runs(
    method: Identifier, known: Known, groups: Sequence[Record]
) -> tuple[Callable[[], object], float]:
    """The update of all the runs, group by group, and the CPU-seconds to compile it."""
    state = method.init(known, jax.random.key(0))
    batch = jax.jit(jax.vmap(method.update, in_axes=(None, record_axes(1, 1, {}))))
    began = time.process_time()
    update = batch.lower(state, groups[0]).compile(_OPTIMISED)
    seconds = time.process_time() - began
    return lambda: [jax.block_until_ready(update(state, group)) for group in groups], seconds


def _numba_recursion(slip: np.ndarray, adhesion: np.ndarray) -> Callable[[], object]:
    """One run after the other, each with its samples in a row."""

    @import_module("numba").njit(fastmath=True)
    def all_runs(slip: Any, adhesion: Any) -> Any:
        found = np.empty((slip.shape[0], 8))
        for run in range(slip.shape[0]):
            x1, x2, p11, p12, p22 = 100.0, 50.0, 1e10, 0.0, 1e10
            g11, g12, g22 = 0.0, 0.0, 0.0
            for k in range(slip.shape[1]):
                size, measured = slip[run, k], adhesion[run, k]
                u1 = size * measured
                u2 = size * u1
                eta = 0.99
                pu1, pu2 = p11 * u1 + p12 * u2, p12 * u1 + p22 * u2
                scale = eta + u1 * pu1 + u2 * pu2
                innovation = 40.0 * size - measured - x1 * u1 - x2 * u2
                squared = (innovation * eta / scale) ** 2
                step = innovation / scale
                x1, x2 = x1 + pu1 * step, x2 + pu2 * step
                p11 = (p11 - pu1 * pu1 / scale) / eta
                p12 = (p12 - pu1 * pu2 / scale) / eta
                p22 = (p22 - pu2 * pu2 / scale) / eta
                g11 = eta**2 * g11 + squared * u1 * u1
                g12 = eta**2 * g12 + squared * u1 * u2
                g22 = eta**2 * g22 + squared * u2 * u2
            found[run] = x1, x2, p11, p12, p22, g11, g12, g22
        return found

    rows = np.ascontiguousarray(slip.T), np.ascontiguousarray(adhesion.T)
    return lambda: all_runs(*rows)


# The forms in NumPy work in place, in arrays that stay in the cache: an array for every
# intermediate result takes 1.3 times as long for the recursion, and three times for the program
# with all the edges of the box for every run.


def numpy_recursion(slip: np.ndarray, adhesion: np.ndarray) -> tuple[np.ndarray, ...]:
    """What `rls-kiencke` does, with arrays [samples, runs], one step for all the runs."""
    runs = slip.shape[1]
    x1, x2 = np.full(runs, _START[0]), np.full(runs, _START[1])
    p11, p12, p22 = np.full(runs, 1e10), np.zeros(runs), np.full(runs, 1e10)
    g11, g12, g22 = np.zeros((3, runs))
    u1, u2, error, eta, pu1, pu2, share, work = np.empty((8, runs))
    for size, measured in zip(slip, adhesion, strict=True):
        _regressors(size, measured, u1, u2, error)
        _factor(size, measured, (x1, x2), (0.99, 0.99, 0.0), eta, work)
        np.multiply(p11, u1, out=pu1)
        pu1 += np.multiply(p12, u2, out=work)
        np.multiply(p12, u1, out=pu2)
        pu2 += np.multiply(p22, u2, out=work)
        np.multiply(u1, pu1, out=share)
        share += np.multiply(u2, pu2, out=work)
        share += eta
        np.divide(1.0, share, out=share)
        error -= np.multiply(x1, u1, out=work)
        error -= np.multiply(x2, u2, out=work)
        error *= share
        x1 += np.multiply(pu1, error, out=work)
        x2 += np.multiply(pu2, error, out=work)
        error *= eta
        u1 *= error
        u2 *= error
        gain1 = np.multiply(pu1, share, out=error)
        gain2 = np.multiply(pu2, share, out=share)
        p11 -= np.multiply(pu1, gain1, out=work)
        p12 -= np.multiply(pu1, gain2, out=work)
        p22 -= np.multiply(pu2, gain2, out=work)
        for element in (p11, p12, p22):
            element /= eta
        _residuals((g11, g12, g22), eta, u1, u2, work)
    return x1, x2, p11, p12, p22, g11, g12, g22, _objective(slip, adhesion, x1, x2)


def numpy_program(
    slip: np.ndarray, adhesion: np.ndarray, box: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, ...]:
    """What `qp-qian2024-2` does, with arrays [samples, runs], one step for all the runs.

    The edges of the box are looked at for those runs alone whose solution lies outside.
    """
    runs, (lower, upper) = slip.shape[1], box
    x1, x2 = np.full(runs, _START[0]), np.full(runs, _START[1])
    h11, h12, h22, f1, f2, g11, g12, g22 = np.zeros((8, runs))
    u1, u2, error, eta, y1, y2, a11, a22, determinant, work = np.empty((10, runs))
    for size, measured in zip(slip, adhesion, strict=True):
        _regressors(size, measured, u1, u2, error)
        _factor(size, measured, (x1, x2), (0.971, 1.0, 2.0), eta, work)
        sums = ((h11, u1, u1), (h12, u1, u2), (h22, u2, u2), (f1, u1, error), (f2, u2, error))
        for total, one, other in sums:
            total *= eta
            total += np.multiply(one, other, out=work)
        pull = np.add(h11, h22, out=work)
        pull *= _RIDGE
        np.add(h11, pull, out=a11)
        np.add(h22, pull, out=a22)
        np.multiply(pull, _START[0], out=y1)
        y1 += f1
        np.multiply(pull, _START[1], out=y2)
        y2 += f2
        np.multiply(a11, a22, out=determinant)
        determinant -= np.multiply(h12, h12, out=work)
        np.multiply(y1, a22, out=x1)
        x1 -= np.multiply(y2, h12, out=work)
        np.multiply(y2, a11, out=x2)
        x2 -= np.multiply(y1, h12, out=work)
        inside = determinant > 0
        with np.errstate(divide="ignore", invalid="ignore"):
            x1 /= determinant
            x2 /= determinant
        for x, least, most in zip((x1, x2), lower, upper, strict=True):
            inside &= x >= least
            inside &= x <= most
        if not inside.all():
            outside = np.flatnonzero(~inside)
            program = (y1[outside], y2[outside], a11[outside], a22[outside], h12[outside])
            x1[outside], x2[outside] = _on_edge(program, box)
        error -= np.multiply(x1, u1, out=work)
        error -= np.multiply(x2, u2, out=work)
        u1 *= error
        u2 *= error
        _residuals((g11, g12, g22), eta, u1, u2, work)
    return x1, x2, h11, h12, h22, g11, g12, g22, _objective(slip, adhesion, x1, x2)


def _regressors(
    size: np.ndarray, measured: np.ndarray, u1: np.ndarray, u2: np.ndarray, z: np.ndarray
) -> None:
    np.multiply(size, measured, out=u1)
    np.multiply(size, u1, out=u2)
    np.multiply(size, 40.0, out=z)
    z -= measured


def _error(
    size: np.ndarray, measured: np.ndarray, x: _Pair, out: np.ndarray, work: np.ndarray
) -> None:
    """The adhesion at this slip less the measured one."""
    np.multiply(x[1], size, out=work)
    work += x[0]
    work *= size
    work += 1.0
    np.multiply(size, 40.0, out=out)
    out /= work
    out -= measured


def _factor(
    size: np.ndarray,
    measured: np.ndarray,
    x: _Pair,
    settings: tuple[float, float, float],
    eta: np.ndarray,
    work: np.ndarray,
) -> None:
    """The forgetting factor for the least one, the largest one and the gain."""
    least, most, gain = settings
    _error(size, measured, x, eta, work)
    np.abs(eta, out=eta)
    eta *= -gain
    eta += most
    np.maximum(eta, least, out=eta)


def _residuals(
    sums: Sequence[np.ndarray], eta: np.ndarray, u1: np.ndarray, u2: np.ndarray, work: np.ndarray
) -> None:
    """Sums of the products of regressors times residuals, the old ones times eta squared."""
    eta *= eta
    for total, one, other in zip(sums, (u1, u1, u2), (u1, u2, u2), strict=True):
        total *= eta
        total += np.multiply(one, other, out=work)


def _on_edge(
    program: tuple[np.ndarray, ...], box: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    y1, y2, a11, a22, a12 = program
    (low1, low2), (high1, high2) = box
    ones = np.ones_like(y1)
    edges = [(np.clip((y1 - e * a12) / a11, low1, high1), e * ones) for e in (low2, high2)]
    edges += [(e * ones, np.clip((y2 - e * a12) / a22, low2, high2)) for e in (low1, high1)]
    x1, x2 = np.array(edges).swapaxes(0, 1)
    values = x1 * (x1 * a11 + 2 * x2 * a12 - 2 * y1) + x2 * (x2 * a22 - 2 * y2)
    best = np.argmin(values, axis=0), np.arange(y1.size)
    return x1[best], x2[best]


def _objective(
    slip: np.ndarray, adhesion: np.ndarray, x1: np.ndarray, x2: np.ndarray
) -> np.ndarray:
    """The sum of squared errors of the last estimate over the record."""
    total, out, work = np.zeros((3, x1.size))
    for size, measured in zip(slip, adhesion, strict=True):
        _error(size, measured, (x1, x2), out, work)
        out *= out
        total += out
    return total
