"""A second simulator of the HXD1F, written from its equations in plain Python.

It shares nothing with the package: parameters, plant, drive, sensors, observer and controller stand
here once more. Speeds are sampled and torque is commanded each millisecond.
"""

import math
import random

R, RG, ETA, G = 0.625, 106 / 17, 0.975, 9.81
W, M, AXLES = 30e3, 1e7, 8
JM, JW = 25.0, 400.0
T_MAX, P_MAX, LAG = 13e3, 1.2e6, 0.01
J = JM + JW / (RG**2 * ETA)
CONTROL = 1e-3


def resistance(speed):
    kmh = 3.6 * abs(speed)
    size = M * 9.81e-3 * (0.92 + 0.0048 * kmh + 0.000125 * kmh**2)
    return size * max(-1.0, min(1.0, speed / 0.01))


class Segments:
    """Exponential curves (v*, mu_max) from some times in s on; b/a = 2.2222."""

    def __init__(self, starts, slips, tops, ratio=2.2222):
        self.starts, self.slips, self.tops = starts, slips, tops
        self.a = [math.log(ratio) / (ratio - 1) / slip for slip in slips]
        self.b = [ratio * a for a in self.a]
        rise = ratio ** (-1 / (ratio - 1)) - ratio ** (-ratio / (ratio - 1))
        self.c = [top / rise for top in tops]

    def at(self, time):
        return sum(time > start - 1e-9 for start in self.starts) - 1

    def adhesion(self, number, slip):
        size = abs(slip)
        found = math.exp(-self.a[number] * size) - math.exp(-self.b[number] * size)
        return math.copysign(self.c[number] * found, slip)


def utilisation(rail, asked, step, duration, pole, gain, seed, below=0.1, above=0.3):
    """Mean of mu/mu_max over samples of a millisecond; `asked(segment)` is the slip asked for."""
    noise = random.Random(seed)
    w, v, torque = RG * 5.0 / R, 5.0, 0.0
    seen, load = w, 0.0
    steps = round(CONTROL / step)
    used, samples = 0.0, round(duration / CONTROL)
    for sample in range(samples):
        number = rail.at(sample * CONTROL)
        used += rail.adhesion(number, R * w / RG - v) / rail.tops[number]
        # Sensors, and the barrier controller on the observed load.
        w_read, v_read = w + noise.gauss(0, 0.02), v + noise.gauss(0, 5e-3)
        error = R * w_read / RG - v_read - asked(number)
        share = max(-0.95, min(0.95, error / (above if error > 0 else below)))
        adhesion = load * RG * ETA / (R * W * G)
        train = (AXLES * W * G * adhesion - resistance(v_read)) / M
        command = load + RG * J / R * (train - gain * error / (1 - share**2))
        command = min(max(command, -0.3 * T_MAX), T_MAX)
        for place in range(steps):
            most = min(T_MAX, P_MAX / max(abs(w), 1e-9))
            wanted = max(-most, min(most, command))
            now = rail.at(sample * CONTROL + place * step)

            def rates(w, v, torque, wanted=wanted, now=now):
                force = rail.adhesion(now, R * w / RG - v) * W * G
                # The gear loses where the motor drives the wheel, and where that drives the motor.
                drives = (JW / RG / JM * torque + R * force) * w >= 0
                eta = ETA if drives else 1 / ETA
                turning = torque - R * force / (RG * eta)
                return (
                    turning / (JM + JW / (RG**2 * eta)),
                    (AXLES * force - resistance(v)) / M,
                    (wanted - torque) / LAG,
                )

            ahead = seen - w_read
            seen, load = (
                seen + step * (2 * pole * ahead + (torque - load) / J),
                load + step * J * pole**2 * ahead,
            )
            x = (w, v, torque)
            k1 = rates(*x)
            k2 = rates(*(a + step / 2 * k for a, k in zip(x, k1, strict=True)))
            k3 = rates(*(a + step / 2 * k for a, k in zip(x, k2, strict=True)))
            k4 = rates(*(a + step * k for a, k in zip(x, k3, strict=True)))
            w, v, torque = (
                a + step / 6 * (p + 2 * q + 2 * s + t)
                for a, p, q, s, t in zip(x, k1, k2, k3, k4, strict=True)
            )
    return used / samples
