"""The traction loop: a plant, its sensors, an observer, a seeker and a controller, in time.

A run is a loop over samples of the metrics; in each of them over control samples; in each of
those over steps of the plant, in which the command is held.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from adhesion_jax.errors import InputError
from adhesion_jax.metrics import closed_loop
from adhesion_jax.metrics.closed_loop import Sample, Totals
from adhesion_jax.programs import kept
from adhesion_jax.traction.controllers import Controller
from adhesion_jax.traction.driver import BRAKING, DONE, Driver, lowered
from adhesion_jax.traction.entrants import Entrant
from adhesion_jax.traction.integration import RK4_STABLE, jacobian, rk4
from adhesion_jax.traction.observers import Observer
from adhesion_jax.traction.plants.base import Held, Plant, held_by, limited
from adhesion_jax.traction.rails import Passed, Rails
from adhesion_jax.traction.seekers import Seeker
from adhesion_jax.traction.sensors import Sensed, Sensors
from adhesion_jax.traction.signals import Measurement, PerAxle, Signals
from adhesion_jax.traction.surface import RailSurface

#: Time between two samples of the metrics in s, or the control period where that is longer.
SAMPLE = 1e-3

#: From the start of a dip of the power to the next, and the length of one, s.
DIPS, DIP = 1.0, 0.2


class Terms(eqx.Module):
    """All of a loop but the rails and the method."""

    plant: Plant
    driver: Driver
    sensors: Sensors
    train_speed: Float[Array, ""]  # at first, m/s
    slip: PerAxle  # at first, m/s
    slope: Float[Array, ""]  # of the track, as an angle in rad; positive uphill

    def loop(self, method: Entrant, rails: Rails) -> "Loop":
        """The loop of a method on some rails; its control knows the plant exactly."""
        return Loop(**vars(self), nominal=self.plant, rails=rails, **method._asdict())


class Loop(Terms):
    """All that a run is made of; `nominal` is the plant as control knows it.

    Numbers among its fields may differ from run to run without a new compilation.
    """

    nominal: Plant
    rails: Rails
    observer: Observer
    seeker: Seeker | None
    controller: Controller
    dip: Float[Array, ""] | float = 0.0  # share of its power that the drive lacks in a dip


class Timing(NamedTuple):
    """The step of the plant in s, and the numbers of steps and periods in each other."""

    step: float
    control: int  # steps in a control period
    sample: int  # control periods in a sample of the metrics
    samples: int  # in the run
    measured: int  # steps from a sample of the sensors to the next
    dead: int  # control periods from a command to its effect, at most

    @property
    def control_period(self) -> float:
        return self.control * self.step

    @property
    def sample_period(self) -> float:
        return self.sample * self.control_period


class Trace(NamedTuple):
    """The signals of a run that are drawn, [samples, ...]."""

    time: Float[Array, ""]
    sample: Sample
    command: PerAxle
    motor_speed: PerAxle
    rim_speed: PerAxle
    rail: Any  # the states of rail, seeker and controller
    seeker: Any
    controller: Any


class _State(NamedTuple):
    plant: Any
    rail: Any
    sensed: Sensed
    observer: Any
    seeker: Any
    controller: Any
    mode: Int[Array, ""]
    steps: Int[Array, ""]
    waiting: Float[Array, "dead axles"]  # commands within the dead time, not yet in effect
    command: PerAxle
    asked: PerAxle
    totals: Any  # Totals, once the first sample is taken


def timing(loop: Loop, step: float, period: float, duration: float) -> Timing:
    """The grid of a run. Raises InputError if times do not divide or the step is too large."""
    limit, by = largest_step(loop)
    if not 0 < step <= limit:
        raise InputError(
            f"--step {step:g} s is not possible: {by} allows at most {limit:.3g} s; give less."
        )
    control = _whole(period, step, "the control period", "steps")
    sample = max(round(SAMPLE / (control * step)), 1)
    measured = 1
    if loop.sensors.period:
        measured = _whole(loop.sensors.period, step, "the sampling period of the sensors", "steps")
        if control % measured and measured % control:
            raise InputError(
                f"the sampling period of the sensors, {loop.sensors.period:g} s, neither divides "
                f"nor is a multiple of the control period of {period:g} s; give a period that does."
            )
    dead = 0
    if float(loop.plant.dead_time) > 0:
        dead = _whole(float(loop.plant.dead_time), period, "the dead time", "control periods")
    samples = _whole(duration, sample * control * step, "the duration", "samples")
    return Timing(step, control, sample, samples, measured, dead)


def _whole(time: float, unit: float, what: str, units: str) -> int:
    count = round(time / unit)
    if count < 1 or abs(count * unit - time) > 1e-9 * max(time, unit):
        raise InputError(
            f"{what} of {time:g} s is no whole number of {units} of {unit:g} s; give a multiple."
        )
    return count


def largest_step(loop: Loop) -> tuple[float, str]:
    """The largest stable step of the plant in s, and the part of the loop that limits it."""
    found = _jacobians(loop.plant, loop.rails, loop.train_speed, loop.slip, loop.slope)
    fastest = float(np.abs(np.linalg.eigvals(found)).max())
    by_plant = RK4_STABLE / fastest if fastest > 0 else np.inf
    by_observer = loop.observer.largest_step(loop.nominal)
    if by_observer < by_plant:
        return by_observer, "the observer, which is integrated by explicit Euler,"
    return by_plant, "the plant, which is integrated by RK4,"


@kept()
def _jacobians(
    plant: Plant,
    rails: Rails,
    train_speed: Float[Array, ""],
    slip: PerAxle,
    slope: Float[Array, ""],
) -> Float[Array, "segments numbers numbers"]:
    """The Jacobian of the plant in 1/s, rolling almost without slip, on each of the surfaces."""
    speed = jnp.maximum(train_speed, 1.0)
    # Not at slip zero, where the sign in an odd law has no derivative.
    state = plant.init(_motor_speed(plant, speed, jnp.full_like(slip, 1e-6)), speed)

    def on(segment: Int[Array, ""]) -> Float[Array, "numbers numbers"]:
        held = Held(jnp.zeros_like(slip), rails.surface(segment), slope)
        return jacobian(lambda state: plant.derivative(state, held), state)

    return jax.vmap(on)(jnp.arange(len(jax.tree.leaves(rails.surfaces)[0])))


def check(loop: Loop) -> None:
    """Raises InputError if the controller needs a seeker and has none, or the reverse."""
    if loop.controller.FOLLOWS and loop.seeker is None:
        raise InputError("the controller follows a slip and has no seeker; name a seeker.")
    if loop.seeker is not None and not loop.controller.FOLLOWS:
        raise InputError(
            "the controller follows no slip, so it takes no seeker; name it without a seeker."
        )


def run(loop: Loop, grid: Timing, key: PRNGKeyArray) -> Totals:
    """The totals of one run."""
    return _advanced(loop, grid, key, _start(loop, grid), jnp.asarray(0), grid.samples).totals


def trace(loop: Loop, grid: Timing, key: PRNGKeyArray, every: int = 1) -> tuple[Totals, Trace]:
    """The totals of one run, and a row of its signals for every `every` samples of the metrics.

    `every` must divide the number of samples of the run.
    """

    def row(state: _State, number: Int[Array, ""]) -> tuple[_State, Trace]:
        seen = _seen(loop, grid, state)
        return _advanced(loop, grid, key, state, number * every, every), seen

    state, rows = jax.lax.scan(row, _start(loop, grid), jnp.arange(grid.samples // every))
    return state.totals, rows


def first_row(loop: Loop, grid: Timing) -> Trace:
    """The first row of the trace of a run."""
    return _seen(loop, grid, _start(loop, grid))


def _advanced(
    loop: Loop, grid: Timing, key: PRNGKeyArray, state: _State, first: Int[Array, ""], count: int
) -> _State:
    """The state after some samples of the metrics, the first of which has that number."""

    def controlled(_: Int[Array, ""], state: _State) -> _State:
        return _control(loop, grid, state, jax.random.fold_in(key, state.steps))

    def one(index: Int[Array, ""], state: _State) -> _State:
        totals = closed_loop.add(
            state.totals, _sample(loop, state), first + index, grid.sample_period
        )
        return jax.lax.fori_loop(0, grid.sample, controlled, state._replace(totals=totals))

    return jax.lax.fori_loop(0, count, one, state)


def _seen(loop: Loop, grid: Timing, state: _State) -> Trace:
    motor = loop.plant.motor_speed(state.plant)
    return Trace(
        time=state.steps * grid.step,
        sample=_sample(loop, state),
        command=state.command,
        motor_speed=motor,
        rim_speed=loop.plant.circumferential(motor),
        rail=state.rail,
        seeker=state.seeker,
        controller=state.controller,
    )


def _motor_speed(plant: Plant, train_speed: Float[Array, ""], slip: PerAxle) -> PerAxle:
    return plant.gear_ratio * (train_speed + slip) / plant.radius


def _start(loop: Loop, grid: Timing) -> _State:
    motor = _motor_speed(loop.plant, loop.train_speed, loop.slip)
    plant = loop.plant.init(motor, loop.train_speed)
    sensed = loop.sensors.init(loop.nominal, motor, loop.train_speed)
    none = jnp.zeros_like(motor)
    mode = loop.driver.update(jnp.zeros((), dtype=int), loop.train_speed)
    state = _State(
        plant,
        loop.rails.init(loop.slip, loop.train_speed),
        sensed,
        loop.observer.init(loop.nominal, _measured(loop, sensed, none)),
        None,
        None,
        mode,
        jnp.zeros((), dtype=int),
        jnp.zeros((grid.dead, motor.size)),
        none,
        jnp.full_like(none, jnp.nan),
        None,
    )
    signals = _signals(loop, grid, state)
    seeker = None if loop.seeker is None else loop.seeker.init(loop.nominal, signals)
    state = state._replace(seeker=seeker, controller=loop.controller.init(loop.nominal, signals))
    totals = closed_loop.start(_sample(loop, state), loop.rails.segments, grid.sample_period)
    return state._replace(totals=totals)


def _measured(loop: Loop, sensed: Sensed, load: PerAxle) -> Measurement:
    """The sensors' signals, and the true load for an observer that declares it is given."""
    told = load if loop.observer.TOLD_LOAD else None
    return Measurement(sensed.motor_speed, sensed.train_speed, sensed.slip, told)


def _segment(loop: Loop, state: _State) -> Int[Array, ""]:
    return loop.rails.segment(state.steps, state.plant.train_speed, state.mode == BRAKING)


def _surface(loop: Loop, state: _State) -> RailSurface:
    segment, speed = _segment(loop, state), state.plant.train_speed
    return loop.rails.present(state.rail, segment, state.steps, speed)


def _held(loop: Loop, state: _State, command: PerAxle) -> Held:
    return Held(command, _surface(loop, state), loop.slope)


def _optimum(loop: Loop, state: _State, price: float = 0.0) -> tuple[PerAxle, PerAxle]:
    """Slip and adhesion that were best for each axle now, the slip with its sign."""
    shape = state.command.shape
    peak = _surface(loop, state).best(state.plant.train_speed, price, *shape)
    sign = jnp.where(state.mode == BRAKING, -1.0, 1.0)
    return jnp.broadcast_to(sign * peak.slip, shape), jnp.broadcast_to(peak.adhesion, shape)


def _signals(loop: Loop, grid: Timing, state: _State) -> Signals:
    load = state.observer.load
    price = None if loop.seeker is None else loop.seeker.told_price
    return Signals(
        time=state.steps * grid.step,
        demand=jnp.broadcast_to(loop.driver.demand(state.mode), load.shape),
        motor_speed=state.sensed.motor_speed,
        train_speed=state.sensed.train_speed,
        slip=state.sensed.slip,
        torque=state.plant.torque,
        load=load,
        adhesion=loop.nominal.adhesion_of(load),
        slip_beside=state.observer.slip,
        optimum=None if price is None else _optimum(loop, state, price)[0],
    )


def _sample(loop: Loop, state: _State) -> Sample:
    held = _held(loop, state, state.command)
    plant = loop.plant
    slip, largest = _optimum(loop, state)
    force = plant.force(state.plant, held)
    lost = force * plant.slip_velocity(state.plant)
    rim = plant.circumferential(plant.motor_speed(state.plant))
    return Sample(
        segment=_segment(loop, state),
        counts=state.mode != DONE,
        direction=jnp.where(state.mode == BRAKING, -1.0, 1.0),
        slip=rim - state.plant.train_speed,
        optimum=slip,
        adhesion=plant.adhesion(state.plant, held),
        largest=largest,
        observed=loop.nominal.adhesion_of(state.observer.load),
        asked=state.asked,
        torque=state.plant.torque,
        shaft=plant.shaft_torque(state.plant),
        static_shaft=plant.static_shaft_torque(slip, state.plant.train_speed, held),
        slip_power=plant.axles_alike * jnp.sum(lost),
        pull=plant.axles_alike * jnp.sum(force),
        largest_pull=plant.pull(largest),
        train_speed=state.plant.train_speed,
    )


def _control(loop: Loop, grid: Timing, state: _State, key: PRNGKeyArray) -> _State:
    """One control sample, and the steps of the plant up to the next one."""
    count = max(grid.control // grid.measured, 1)
    drawn = loop.sensors.draw(key, count, state.command.size)
    mode = loop.driver.update(state.mode, state.plant.train_speed)
    sensed = _sensed(loop, state, state.steps % grid.measured == 0, drawn[0])
    state = state._replace(mode=mode, sensed=sensed)

    signals = _signals(loop, grid, state)
    seeker, asked, period = state.seeker, state.asked, grid.control_period
    if loop.seeker is not None:
        seeker, reference = loop.seeker.update(seeker, loop.nominal, signals, period)
        signals, asked = signals._replace(reference=reference), reference.slip
    controller, wanted = loop.controller.update(state.controller, loop.nominal, signals, period)
    waiting = jnp.concatenate([state.waiting, lowered(signals.demand, wanted)[None]])
    state = state._replace(seeker=seeker, controller=controller, waiting=waiting[1:], asked=asked)
    late = jnp.round(loop.plant.dead_time / period).astype(int)
    acting = waiting[grid.dead - late]

    def stepped(index: Int[Array, ""], state: _State) -> _State:
        if grid.measured < grid.control:
            later = (index % grid.measured == 0) & (index > 0)
            noise = jax.lax.dynamic_index_in_dim(drawn, index // grid.measured, keepdims=False)
            state = state._replace(sensed=_sensed(loop, state, later, noise))
        return _stepped(loop, grid, state, acting)

    return jax.lax.fori_loop(0, grid.control, stepped, state)


def _sensed(
    loop: Loop, state: _State, fresh: Bool[Array, ""], drawn: Float[Array, " speeds"]
) -> Sensed:
    speeds = (loop.plant.motor_speed(state.plant), state.plant.train_speed)
    return loop.sensors.sample(state.sensed, loop.nominal, speeds, fresh, drawn)


def _stepped(loop: Loop, grid: Timing, state: _State, acting: PerAxle) -> _State:
    """One step of the plant and of the observer beside it."""
    plant = loop.plant
    dips = (state.steps * grid.step) % DIPS >= DIPS - DIP
    share = jnp.where(dips, 1 - loop.dip, 1.0)
    command = limited(plant, acting, plant.motor_speed(state.plant), share)
    held = _held(loop, state, command)
    before = state.plant._replace(torque=held_by(plant, state.plant.torque, command))
    adhesion = plant.adhesion(before, held)
    measured = _measured(loop, state.sensed, loop.nominal.load_of(adhesion))
    observer = loop.observer.update(
        state.observer, loop.nominal, measured, before.torque, grid.step
    )
    after = rk4(lambda one: plant.derivative(one, held), before, grid.step)
    slip = plant.slip_velocity(before).reshape(-1, adhesion.size).mean(axis=0)
    passed = Passed(_segment(loop, state), slip, adhesion, before.train_speed)
    rail = loop.rails.update(state.rail, passed, grid.step)
    sensed = loop.sensors.turn(state.sensed, plant.motor_speed(state.plant), grid.step)
    return state._replace(
        plant=after,
        rail=rail,
        sensed=sensed,
        observer=observer,
        steps=state.steps + 1,
        command=command,
    )
