"""Recursive refined instrumental variables on the linear form of Kiencke's curve, made robust."""

from functools import partial
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from adhesion_jax.curves import free_values
from adhesion_jax.identifiers.base import Estimate, Identifier
from adhesion_jax.identifiers.curve_fit import start, to_estimate
from adhesion_jax.identifiers.kiencke_linear import fitted, needs_kiencke, regression
from adhesion_jax.identifiers.online import OnlineState, over_fresh_samples
from adhesion_jax.optim.quadratic_program import bounded_pair
from adhesion_jax.scenarios import Known, Record, Scenario

import os
_E = lambda n, d: float(os.environ.get(n, d))
_LENGTH = int(_E("LENGTH", 40))
_PASSES_NEW = int(_E("PNEW", 5))
_PASSES = int(_E("PASSES", 5))
_HUBER = _E("HUBER", 2.0)
_SKIP = _E("SKIP", 1e9)
_GAIN = _E("GAIN", 0.02)
_PRIOR = _E("PRIOR", 0.1)
_START = int(_E("START", 20))
_MEDIAN = 0.6744897501960817
_OPTIMAL = 2.33
_FLOOR = 1e-9


class Window(NamedTuple):
    slip: Float[Array, "length"]
    adhesion: Float[Array, "length"]
    surprise: Float[Array, "length"]
    held: Bool[Array, "length"]


class Sums(NamedTuple):
    h11: Float[Array, ""]
    h12: Float[Array, ""]
    h22: Float[Array, ""]
    f1: Float[Array, ""]
    f2: Float[Array, ""]
    count: Float[Array, ""]
    weights: Float[Array, ""]
    linear: Float[Array, ""]
    squares: Float[Array, ""]


class Recursion(NamedTuple):
    window: Window
    sums: Sums
    x: Float[Array, "2"]
    scale: Float[Array, ""]
    samples: Int[Array, ""]
    age: Int[Array, ""]
    kept: Float[Array, ""]


def _weight(nu):
    size = jnp.abs(nu)
    return jnp.where(size > _SKIP, 0.0, jnp.where(size > _HUBER, _HUBER / size, 1.0))


def _terms(known, x, slip, adhesion):
    d = 1 + x[0] * slip + x[1] * slip**2
    model = known.curve.a0 * slip / d
    return d, model


def _median(values, held):
    count = jnp.sum(held)
    ordered = jnp.sort(jnp.where(held, values, jnp.inf))
    low, high = ordered[jnp.maximum((count - 1) // 2, 0)], ordered[count // 2]
    return 0.5 * (low + high)


class RefinedInstruments(Identifier):
    fits_last_record: ClassVar[bool] = False

    def accepts(self, scenario: Scenario) -> str | None:
        return needs_kiencke(scenario)

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        batch = start(known, key)
        zeros = jnp.zeros(_LENGTH)
        zero, none = jnp.zeros(()), jnp.int32(0)
        window = Window(zeros, zeros, zeros, zeros > 0)
        sums = Sums(*(zero for _ in Sums._fields))
        return OnlineState(batch, Recursion(window, sums, batch.fit.parameters, zero + _FLOOR, none, none, zero + 1.0))

    def update(self, state: OnlineState, record: Record) -> OnlineState:
        known = state.batch.known
        r = state.recursion._replace(kept=jnp.ones(()))
        r = over_fresh_samples(partial(self._step, known), r, record)
        fit = fitted(known, record, state.batch.fit, r.x, self._covariance(r.sums), r.kept,
            jnp.sum(record.fresh, dtype=jnp.int32), r.sums.count > 2)
        return OnlineState(state.batch._replace(fit=fit), r)

    def estimate(self, state: OnlineState) -> Estimate:
        return to_estimate(state.batch)

    def _inverse(self, s):
        det = s.h11 * s.h22 - s.h12**2
        det = jnp.where(det > 0, det, jnp.nan)
        return s.h22 / det, -s.h12 / det, s.h11 / det

    def _covariance(self, s):
        a, b, c = self._inverse(s)
        factor = s.squares / jnp.maximum(s.count - 2, 1) * s.weights * s.count / jnp.maximum(s.linear, 1)**2
        return factor * jnp.array([[a, b], [b, c]])

    def _solve(self, known, s):
        return jnp.stack(bounded_pair(s.f1, s.f2, s.h11, s.h22, s.h12,
            (known.lower[0], known.upper[0]), (known.lower[1], known.upper[1])))

    def _step(self, known, r, slip, adhesion):
        a0 = known.curve.a0
        slip, adhesion = jnp.abs(slip), jnp.sign(slip) * adhesion
        x, s = r.x, r.sums
        # prediction
        d, model = _terms(known, x, slip, adhesion)
        g1 = model * slip / d
        g2 = g1 * slip
        ia, ib, ic = self._inverse(s)
        leverage = jnp.where(r.age > 1, ia * g1 * g1 + 2 * ib * g1 * g2 + ic * g2 * g2, 1.0)
        leverage = jnp.maximum(leverage, 0.0)
        e = adhesion - model
        nu = e / (r.scale * jnp.sqrt(1 + leverage))
        w = _weight(nu)
        # recursion
        z1 = w * g1 / d
        z2 = z1 * slip
        u1, u2, z = slip * adhesion, slip**2 * adhesion, a0 * slip - adhesion
        s = Sums(s.h11 + z1 * u1, s.h12 + z1 * u2, s.h22 + z2 * u2, s.f1 + z1 * z, s.f2 + z2 * z,
            s.count + 1, s.weights + w, s.linear + (jnp.abs(nu) < _HUBER), s.squares + w**2 * e**2 / (1 + leverage))
        x = self._solve(known, s)
        # votes
        size = jnp.where(r.samples < _START, 0.0, jnp.abs(nu))
        win = r.window
        push = lambda new, old: jnp.concatenate([new[None], old[:-1]])
        win = Window(push(slip, win.slip), push(adhesion, win.adhesion), push(size, win.surprise), push(slip > -1, win.held))
        few = (win.surprise > 3.0) & (jnp.arange(_LENGTH) < 5)
        many = (win.surprise > 2.2) & (jnp.arange(_LENGTH) < 10)
        fast, slow = jnp.sum(few) >= 4, jnp.sum(many) >= 8
        reset = fast | slow
        held = jnp.where(reset, jnp.where(fast, few, many), win.held)
        win = win._replace(held=held, surprise=jnp.where(reset, 0.0, win.surprise))
        samples = r.samples + 1
        age = jnp.where(reset, 10, jnp.minimum(r.age + 1, _LENGTH + 1))
        gain = jnp.maximum(_OPTIMAL / samples, _GAIN)
        scale = r.scale * jnp.exp(gain * (jnp.where(jnp.abs(nu) > _MEDIAN, 0.5, -0.5)))
        scale = jnp.maximum(scale, _FLOOR)
        young = age <= _LENGTH
        first = age == samples
        passes = jnp.where(young, jnp.where(reset | (samples < 10), _PASSES_NEW, _PASSES), 0)
        lin = passes >= 5
        x, s, scale = self._refit(known, win, x, s, scale, first, passes)
        return Recursion(win, s, x, scale, samples, age, jnp.where(reset, 0.0, r.kept))

    def _refit(self, known, win, x, s, scale, first, passes):
        a0 = known.curve.a0
        l, mu, held = win.slip, win.adhesion, win.held
        n = jnp.sum(held)
        precision = 1 / (_PRIOR * (known.upper - known.lower)) ** 2
        x0 = free_values(known.curve)
        u1, u2, z = l * mu, l**2 * mu, a0 * l - mu
        scratch = passes >= 5

        def body(i, carry):
            x, s, scale = carry
            d, model = _terms(known, x, l, mu)
            e = mu - model
            mad = _median(jnp.abs(e), held) / _MEDIAN * jnp.sqrt(n / jnp.maximum(n - 2, 1))
            mad = jnp.where(n < 5, jnp.maximum(mad, 0.05 * jnp.max(jnp.where(held, jnp.abs(mu), 0))), mad)
            scale = jnp.where(first, jnp.maximum(mad, _FLOOR), scale)
            lin = scratch & (i == 0)
            nu = e / scale
            w = jnp.where(held, jnp.where(lin, 1.0, _weight(nu)), 0.0)
            z1 = w * jnp.where(lin, u1, model * l / d**2)
            z2 = z1 * l
            p1, p2 = scale**2 * precision
            sums = Sums(jnp.sum(z1 * u1) + p1, jnp.sum(z1 * u2), jnp.sum(z2 * u2) + p2,
                jnp.sum(z1 * z) + p1 * x0[0], jnp.sum(z2 * z) + p2 * x0[1],
                n + 0.0, jnp.sum(w), jnp.sum(held & (jnp.abs(nu) < _HUBER)) + 0.0, jnp.sum(w**2 * e**2))
            return self._solve(known, sums), sums, scale

        return jax.lax.fori_loop(0, passes, body, (x, s, scale))


riv = RefinedInstruments()
