"""What a contact remembers: its own deformation, the dirt that it cleans, sand."""

import jax.numpy as jnp

from adhesion_jax.effects.api import (
    AdhesionTransform,
    Conditions,
    Facts,
    Multiplier,
    Scalar,
    Signal,
    Values,
)
from adhesion_jax.effects.dynamic import (
    Dynamic,
    Filtered,
    Lagging,
    State,
    Stepped,
    Value,
    filtered,
    has_history,
    lagged,
    now,
    rate,
    recurrence,
    steps,
)


class Relaxation(Lagging):
    length: Scalar

    FACTS = Facts(
        source="Pacejka 2012, Tire and Vehicle Dynamics, chapter 7",
        described={"length": ("m", 0.0, 100.0, "relaxation length")},
        strengths=("length",),
        starts=tuple({"length": length} for length in (0.3, 1.0, 3.0, 10.0)),
        needs=("vehicle_speed_mps", "time_s"),
        sentence="The contact takes a distance, not a time, to build up force.",
        formula="(s/V) dmu/dt + mu = mu_steady, s the relaxation length in m, V the vehicle "
        "speed in m/s",
        phrase="relaxation of the contact",
        family="in time",
    )

    def time(self, conditions: Conditions) -> Values:
        return self.length / jnp.maximum(conditions["vehicle_speed_mps"], 0.1)


class Hysteresis(Multiplier, Dynamic):
    k: Scalar
    rate: Scalar
    memory: Scalar

    # A memory of some seconds keeps h far below one, so that k may exceed one.
    FACTS = Facts(
        source="Zhang et al. 2002; Trummer et al. 2017, Wear 378:1-9",
        described={
            "k": ("1", -3.0, 3.0, "relative difference, rising less steady"),
            "rate": ("1/s", 1e-05, 10.0, "slip rate of full effect"),
            "memory": ("s", 0.0, 5.0, "time it takes to turn"),
        },
        strengths=("k",),
        starts=tuple(
            {"k": 0.03, "rate": rate, "memory": 0.02} for rate in (0.001, 0.005, 0.02, 0.1)
        ),
        needs=("time_s",),
        sentence="Adhesion differs between rising and falling slip.",
        formula="mu (1 + k h), T dh/dt + h = tanh((d|l|/dt)/s), s in 1/s, T the memory in s, "
        "h = 0 before the run",
        phrase="hysteresis",
        family="in time",
        rests_on=("slip_ratio", "time_s"),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        direction = jnp.tanh(rate(jnp.abs(slip), conditions) / self.rate)
        turning = lagged(direction, self.memory, conditions)
        if has_history(conditions):  # a run begins at rest, a step before its first point
            passed = jnp.cumsum(steps(conditions)) + steps(conditions)[1:2].sum()
            turning = turning - direction[0] * jnp.exp(-passed / (self.memory + 1e-12))
        return 1 + self.k * turning

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        nothing = jnp.zeros(())
        return Filtered(now(conditions), nothing, nothing), jnp.abs(slip)

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        turning, before = state
        passed = now(conditions) - turning.time
        change = (jnp.abs(slip) - before) / jnp.where(passed > 0, passed, jnp.inf)
        turning = filtered(turning, jnp.tanh(change / self.rate), self.memory, now(conditions))
        return (turning, jnp.abs(slip)), adhesion * (1 + self.k * turning.value)


#: F0 of the formula: the load in N at which the slip energy is counted with the factor 1.
_LOAD = 1e5


class Cleaning(AdhesionTransform, Dynamic):
    """The work W is in m; with q = 1 it is the slip energy over 100 kN, with q = 0 over the load.

    The source mixes a dirty and a recovered curve by the same weight.
    """

    k: Scalar
    work: Scalar
    load_power: Scalar

    FACTS = Facts(
        source="Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618",
        described={
            "k": ("1", -0.9, 5.0, "relative gain once clean"),
            "work": ("m", 0.001, 1000.0, "slip work that cleans to 63 %"),
            "load_power": ("1", 0.0, 1.0, "power of the load in the work"),
        },
        strengths=("k",),
        starts=tuple(
            {"k": 0.05, "work": work, "load_power": 0.5} for work in (0.1, 0.3, 1.0, 3.0, 10.0)
        ),
        needs=("vehicle_speed_mps", "time_s"),
        sentence="Slipping wheels clean the rail: adhesion recovers with the work done in the "
        "contact.",
        formula="mu (1 + k (1 - exp(-W/W0))), W the integral of |mu| |l| V (F/F0)^q dt since the "
        "run began",
        phrase="cleaning by slip",
        family="cleaning",
        one_sided=True,
        rests_on=("slip_ratio", "vehicle_speed_mps", "time_s"),
    )
    ORDER = 2

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        if not has_history(conditions):
            return adhesion
        work = jnp.cumsum(self._power(adhesion, slip, conditions) * steps(conditions))
        return adhesion * (1 - self.k * jnp.expm1(-work / self.work))

    def _power(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        """Slip power over the load, m/s."""
        slip_velocity = jnp.abs(slip) * conditions["vehicle_speed_mps"]
        load = jnp.asarray(conditions.get("normal_load_N", _LOAD)) / _LOAD
        return jnp.abs(adhesion) * slip_velocity * load**self.load_power

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        return now(conditions), jnp.zeros(())

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        time, work = state
        work = work + self._power(adhesion, slip, conditions) * (now(conditions) - time)
        return (now(conditions), work), adhesion * (1 - self.k * jnp.expm1(-work / self.work))


class Sanding(Multiplier, Dynamic):
    """In the source the build-up takes about 1 s and the decay 5 to 12 s."""

    k: Scalar
    build_up: Scalar
    decay: Scalar

    FACTS = Facts(
        source="Arias-Cuevas et al. 2010, Wear 268:543-551",
        described={
            "k": ("1", -0.9, 3.0, "relative gain under sand"),
            "build_up": ("s", 0.05, 10.0, "time constant of arrival"),
            "decay": ("s", 0.05, 60.0, "time constant of loss"),
        },
        strengths=("k",),
        starts=tuple(
            {"k": 0.05, "build_up": up, "decay": down}
            for up in (0.3, 1.0)
            for down in (0.3, 3.0, 8.0)
        ),
        needs=("sanding", "time_s"),
        sentence="Sand raises adhesion; it takes time to arrive and stays for a while.",
        formula="mu (1 + k s), s following the sanding flag: build-up over t1, decay over t2, in s",
        phrase="sanding",
        family="sand",
        one_sided=True,
        rests_on=("sanding",),
        same_as=("covariate:sanding",),
        driven_by="sanding",
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        flag = conditions["sanding"]
        if not has_history(conditions):
            return jnp.asarray(1 + self.k * flag)
        on = jnp.exp(-steps(conditions) / self.build_up)
        off = jnp.exp(-steps(conditions) / self.decay)
        kept = flag * on + (1 - flag) * off
        sand = recurrence(kept, (1 - kept) * flag)
        return 1 + self.k * sand

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        return now(conditions), jnp.zeros(())

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        time, sand = state
        flag = conditions["sanding"]
        passed = now(conditions) - time
        kept = flag * jnp.exp(-passed / self.build_up) + (1 - flag) * jnp.exp(-passed / self.decay)
        sand = kept * sand + (1 - kept) * flag
        return (now(conditions), sand), adhesion * (1 + self.k * sand)
