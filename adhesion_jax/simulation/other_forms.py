"""The same causes by other formulas than the catalogue's: no law of nature reads our code."""

from collections.abc import Callable

import numpy as np

from adhesion_jax.simulation.planted import Bend, Plan, Planted, unbent
from adhesion_jax.simulation.runs import Columns, Runs

#: A factor of the adhesion at an amount, [runs, points].
Factor = Callable[[float], np.ndarray]


def perturbed(name: str, runs: Runs, curve: Bend, generator: np.random.Generator) -> Plan:
    """The cause by another formula; `curve` is the base law of these runs, slip to adhesion."""
    match name:
        case "load_slope":
            return _load_slope(runs)
        case "slip_bias":
            return _slip_bias()
        case "lateral_creep":
            return _lateral_creep(runs)
        case "cleaning":
            return _cleaning(runs, curve, generator)
        case "torque_offset":
            return _torque_offset(runs)
        case "inertia":
            return _inertia(runs)
        case "lag":
            return _lag(runs)
        case "relaxation":
            return _relaxation(runs)
        case "delay":
            return _delay(runs, generator)
    factor, limit = _factor(name, runs, generator)

    def make(amount: float) -> Planted:
        shape = factor(amount)
        return _planted(amount, 1, after=lambda adhesion: adhesion * shape)

    return Plan(make, limit)


def _planted(
    amount: float, order: int, before: Bend = unbent, after: Bend = unbent, **more: float
) -> Planted:
    return Planted(order, before, after, unbent, {"amount": amount, **more})


def _factor(name: str, runs: Runs, generator: np.random.Generator) -> tuple[Factor, float]:
    """What adhesion is multiplied by, and the largest amount."""
    columns, slip, draw = runs.columns, runs.slip, generator.uniform
    speed, slip_velocity = _speeds(runs)
    match name:
        case "speed":
            return lambda a: 1 / (1 + a * speed / 20), 5.0
        case "slip_speed":
            return lambda a: 1 / (1 + a * slip_velocity) ** 2, 5.0
        case "falling_friction":
            return lambda a: 1 - a + a / (1 + slip_velocity / 0.6), 0.95
        case "contact_heating":
            flash = np.abs(slip) * np.sqrt(speed)
            return lambda a: 1 / (1 + a * flash), 20.0
        case "load_peak":
            square = (columns["normal_load_N"] / 150e3) ** 2
            return lambda a: 1 - a * square, 0.95
        case "humidity":
            centre, width = draw(50.0, 75.0), draw(5.0, 10.0)
            wet = 1 / (1 + np.exp(-(columns["relative_humidity_pct"] - centre) / width))
            return lambda a: 1 - a * wet, 0.95
        case "temperature":
            celsius = columns["temperature_C"]
            warm = (celsius - celsius.min()) / np.ptp(celsius)
            return lambda a: 1 + a * warm**2, 2.0
        case "patch":
            centre = float(np.quantile(columns["position_m"], draw(0.3, 0.7)))
            place = np.clip((columns["position_m"] - centre) / draw(70.0, 150.0), -1, 1)
            bump = 0.5 * (1 + np.cos(np.pi * place))
            return lambda a: 1 - a * bump, 0.95
        case "sanding":
            sand = _sand(columns, generator)
            return lambda a: 1 + a * sand, 2.5
        case "axle_position":
            clean = 1 - 0.5 ** (columns["axle"] - 1)
            return lambda a: 1 + a * clean, 2.5
        case "hysteresis":
            memory = _sign_memory(np.abs(slip), columns["time_s"])
            return lambda a: 1 + a * memory, 0.9
        case "curve":
            bent = np.abs(columns["curvature_per_m"])
            return lambda a: 1 - a * bent / (bent + 1e-3), 0.95
        case "load_transfer":
            return lambda a: 1 + a * np.tanh(_rate(speed, columns["time_s"]) / 0.5), 0.9
        case "mode_asymmetry":
            braking = (slip < 0) * np.abs(slip) / (np.abs(slip) + 0.01)
            return lambda a: 1 - a * braking, 0.95
        case "wheel_order":
            turn = columns["wheel_angle_rad"] * int(generator.integers(1, 4)) + draw(0, 2 * np.pi)
            return lambda a: 1 + a * (np.sin(turn) + 0.3 * np.sin(2 * turn + 1)), 0.7
        case "rail_joint":
            length = draw(9.0, 33.0)
            near = np.abs((columns["position_m"] / length + draw(0, 1)) % 1 - 0.5)
            return lambda a: 1 - a * np.exp(-((near / 0.15) ** 2)), 0.95
        case "drift":
            time = columns["time_s"]
            worn = -np.expm1(-(time - time.min()) / (0.3 * np.ptp(time)))
            return lambda a: 1 - a * worn, 0.95
        case "unknown_column":
            age = columns["rail_age_days"] - columns["rail_age_days"].min()
            old = -np.expm1(-age / (0.4 * age.max()))
            return lambda a: 1 - a * old, 0.95
        case "product":
            warm = (columns["temperature_C"] - np.mean(columns["temperature_C"])) / 10
            steep = np.tanh(columns["gradient_permille"] / 8)
            return lambda a: np.maximum(1 + a * warm * steep, 0.05), 0.6
        case _:  # periodic
            wave = np.sin(2 * np.pi * columns["groove_depth_um"] / draw(11.0, 29.0))
            return lambda a: 1 + a * np.sign(wave) * np.abs(wave) ** 0.6, 0.9


def _load_slope(runs: Runs) -> Plan:
    relative = runs.columns["normal_load_N"] / np.median(runs.columns["normal_load_N"])

    def make(amount: float) -> Planted:
        return _planted(amount, 0, before=lambda slip: slip / (1 + amount * relative**2))

    return Plan(make, 5.0)


def _slip_bias() -> Plan:
    def make(amount: float) -> Planted:
        # A wrong radius stretches the slip a little as well.
        return _planted(
            amount, 0, before=lambda slip: slip + amount * np.sign(slip) * (1 + np.abs(slip))
        )

    return Plan(make, 0.04)


def _lateral_creep(runs: Runs) -> Plan:
    """The powers of 1.6 add up where the catalogue takes the squares."""
    lateral = np.abs(np.tan(np.deg2rad(runs.columns["angle_of_attack_deg"])))

    def make(amount: float) -> Planted:
        def total(slip: np.ndarray) -> np.ndarray:
            return (np.abs(slip) ** 1.6 + (amount * lateral) ** 1.6) ** (1 / 1.6)

        share = np.abs(runs.slip) / total(runs.slip)

        return _planted(
            amount,
            0,
            before=lambda slip: np.sign(slip) * total(slip),
            after=lambda adhesion: adhesion * share,
        )

    return Plan(make, 30.0)


def _cleaning(runs: Runs, curve: Bend, generator: np.random.Generator) -> Plan:
    """(1 - s) dirty + s clean, s = 1 - exp(-work/W0): two curves, as in Voltr and Lata 2015."""
    _, slip_velocity = _speeds(runs)
    work = np.cumsum(np.abs(curve(runs.slip)) * slip_velocity * _step(runs), axis=1)
    clean = -np.expm1(-work / generator.uniform(0.3, 1.0))
    flatter = curve(0.6 * runs.slip) / curve(runs.slip)

    def make(amount: float) -> Planted:
        dirty = (1 - amount) * flatter**amount
        return _planted(amount, 1, after=lambda adhesion: adhesion * ((1 - clean) * dirty + clean))

    return Plan(make, 0.95)


def _torque_offset(runs: Runs) -> Plan:
    speed, _ = _speeds(runs)

    def make(amount: float) -> Planted:
        loss = amount * (1 + 0.3 * speed / 15) * np.sign(runs.slip)
        return _planted(amount, 1, after=lambda adhesion: adhesion + loss)

    return Plan(make, 0.3)


def _inertia(runs: Runs) -> Plan:
    """The acceleration has passed a filter of .15 s."""
    speed, _ = _speeds(runs)
    wheel = _rate(speed * (1 + runs.slip), runs.columns["time_s"])
    filtered = _lagged(wheel, np.full_like(wheel, 0.15), _step(runs))

    def make(amount: float) -> Planted:
        return _planted(amount, 2, after=lambda adhesion: adhesion + amount * filtered)

    return Plan(make, 0.9)


def _lag(runs: Runs) -> Plan:
    """Two filters of half the time constant, one after the other."""
    step, shape = _step(runs), runs.slip.shape

    def make(amount: float) -> Planted:
        half = np.full(shape, amount / 2)
        return _planted(
            amount,
            2,
            after=lambda adhesion: _lagged(_lagged(adhesion, half, step), half, step),
        )

    return Plan(make, 10.0)


def _relaxation(runs: Runs) -> Plan:
    """The length shrinks as the contact slides."""
    speed, _ = _speeds(runs)
    share = 1 / (1 + np.abs(runs.slip) / 0.05) / speed

    def make(amount: float) -> Planted:
        return _planted(
            amount, 2, after=lambda adhesion: _lagged(adhesion, amount * share, _step(runs))
        )

    return Plan(make, 90.0)


def _delay(runs: Runs, generator: np.random.Generator) -> Plan:
    """Not the same in every run: a tenth of spread."""
    clock = runs.columns["time_s"] - runs.columns["time_s"][:, :1]
    spread = 1 + 0.1 * generator.standard_normal((len(clock), 1))

    def make(amount: float) -> Planted:
        late = clock - amount * spread
        return _planted(
            amount,
            2,
            after=lambda adhesion: np.stack(
                [np.interp(*run) for run in zip(late, clock, adhesion, strict=True)]
            ),
        )

    return Plan(make, 4.0)


def _speeds(runs: Runs) -> tuple[np.ndarray, np.ndarray]:
    """Vehicle speed and size of the slip velocity, m/s."""
    speed = runs.columns["vehicle_speed_mps"]
    return speed, np.abs(runs.slip) * speed


def _step(runs: Runs) -> float:
    return float(np.median(np.diff(runs.columns["time_s"], axis=1)))


def _rate(signal: np.ndarray, time: np.ndarray) -> np.ndarray:
    return np.gradient(signal, float(np.median(np.diff(time, axis=1))), axis=1)


def _lagged(signal: np.ndarray, time_constant: np.ndarray, step: float) -> np.ndarray:
    """First-order lag, by the exact response to steps; it starts settled."""
    kept = np.exp(-step / np.maximum(time_constant, 1e-6))
    out = signal.copy()
    for k in range(1, signal.shape[1]):
        out[:, k] = kept[:, k] * out[:, k - 1] + (1 - kept[:, k]) * signal[:, k]
    return out


def _sand(columns: Columns, generator: np.random.Generator) -> np.ndarray:
    """Sand arrives at once after a dead time of .5 to 1 s and wears off linearly over 4 to 8 s."""
    time = columns["time_s"]
    step = float(np.median(np.diff(time, axis=1)))
    dead = round(generator.uniform(0.5, 1.0) / step)
    flag = np.pad(columns["sanding"], ((0, 0), (dead, 0)))[:, : time.shape[1]]
    loss = step / generator.uniform(4.0, 8.0)
    sand = flag.copy()
    for k in range(1, time.shape[1]):
        sand[:, k] = np.maximum(flag[:, k], sand[:, k - 1] - loss)
    return sand


def _sign_memory(size: np.ndarray, time: np.ndarray) -> np.ndarray:
    """The last direction in which slip went, forgotten over .3 s."""
    direction = np.sign(_rate(size, time))
    step = float(np.median(np.diff(time, axis=1)))
    return _lagged(direction, np.full_like(direction, 0.3), step)
