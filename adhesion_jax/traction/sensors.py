"""The sensors of speed: sampled and held, with noise, pulses, bias and a wrong radius."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle


class SpeedNoise(NamedTuple):
    """Standard deviations of white noise in the speeds of motor and train, in rad/s and m/s."""

    motor: Float[Array, ""] | float
    train: Float[Array, ""] | float


class Sensors(eqx.Module):
    """`period` is the time from a sample to the next in s, 0 for the step of the plant.

    `pulses` counts the pulses of the encoder in a turn of the motor, 0 for one without steps: the
    speed is the angle between the last two pulses, over the time between them. `count_error` is
    the share by which that speed is too large, as where the encoder has more pulses than is known.
    `train_bias` in m/s is added to the speed of the train; `radius_error` is the share by which
    the radius that slip is computed with is too large.
    """

    noise: SpeedNoise | None = None
    train_bias: Float[Array, ""] | float = 0.0
    radius_error: Float[Array, ""] | float = 0.0
    count_error: Float[Array, ""] | float = 0.0
    period: float = eqx.field(default=0.0, static=True)
    pulses: int = eqx.field(default=0, static=True)

    def draw(self, key: PRNGKeyArray, samples: int, axles: int) -> Float[Array, "samples speeds"]:
        """The noise of some samples, in units of its standard deviations; the train's stands last.

        Without noise nothing is drawn. Single precision is enough for the size of an error: it
        takes half the time, and its tails end at 5.4 standard deviations. All are drawn as one row:
        from rows as short as the number of speeds the compiler makes loops 3.5 times as slow.
        """
        if self.noise is None:
            return jnp.zeros((samples, axles + 1))
        drawn = jax.random.normal(key, (samples * (axles + 1),), dtype=jnp.float32)
        # Without the barrier the compiler would draw the same numbers again at every use.
        return jax.lax.optimization_barrier(drawn).astype(float).reshape(samples, axles + 1)

    def init(self, nominal: Plant, motor_speed: PerAxle, train_speed: Float[Array, ""]) -> "Sensed":
        """The sensors at rest on the true speeds; the first sample is taken at once."""
        slip = nominal.circumferential(motor_speed) - train_speed
        none = jnp.zeros_like(motor_speed)
        return Sensed(motor_speed, train_speed, slip, none, none, motor_speed)

    def sample(
        self,
        sensed: "Sensed",
        nominal: Plant,
        speeds: tuple[PerAxle, Float[Array, ""]],
        fresh: Bool[Array, ""],
        drawn: Float[Array, " speeds"],
    ) -> "Sensed":
        """The sensors after the true speeds have been sampled, where a sample is due."""
        motor_speed, train_speed = speeds
        if self.pulses:
            motor_speed = sensed.read
        if self.noise is not None:
            motor_speed = motor_speed + self.noise.motor * drawn[:-1]
            train_speed = train_speed + self.noise.train * drawn[-1]
        motor_speed = (1 + self.count_error) * motor_speed
        train_speed = train_speed + self.train_bias
        rim = (1 + self.radius_error) * nominal.circumferential(motor_speed)
        taken = sensed._replace(
            motor_speed=motor_speed,
            train_speed=train_speed,
            slip=rim - train_speed,
        )
        return jax.tree.map(lambda new, old: jnp.where(fresh, new, old), taken, sensed)

    def turn(self, sensed: "Sensed", motor_speed: PerAxle, step: float) -> "Sensed":
        """After the motor has turned for a step of the plant."""
        if not self.pulses:
            return sensed
        turned = sensed.turned + step * motor_speed
        # Kept within a pulse: `turned` is the angle since the last one.
        pulse = 2 * jnp.pi / self.pulses
        count = jnp.floor(turned / pulse)
        over = turned - count * pulse
        passed, since = count != 0, sensed.since + step
        late = over / jnp.where(passed, motor_speed, 1.0)
        read = count * pulse / jnp.maximum(since - late, 1e-9)
        return sensed._replace(
            turned=over,
            since=jnp.where(passed, late, since),
            read=jnp.where(passed, read, sensed.read),
        )


class Sensed(NamedTuple):
    """What was measured last: rad/s, m/s and m/s.

    Of an encoder: angle in rad and time in s since the last pulse, and the speed read in rad/s.
    """

    motor_speed: PerAxle
    train_speed: Float[Array, ""]
    slip: PerAxle
    turned: PerAxle
    since: PerAxle
    read: PerAxle
