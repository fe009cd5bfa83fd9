import jax.numpy as jnp

from adhesion_jax.effects.api import AdhesionTransform, Conditions, Facts, Scalar, Signal
from adhesion_jax.effects.dynamic import Dynamic, State, Stepped, Value, has_history, now, steps

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
