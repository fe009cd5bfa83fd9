"""A locomotive with its train on the line: speeds, force and slip from the equations of motion."""

import numpy as np

#: Mass of the train and load on a wheelset, kg; creep stiffness, adhesion for each slip ratio.
TRAIN, AXLE, STIFFNESS = 400e3, 21.2e3, 40.0


def trip(seed, seconds=1800.0, step=0.05, vehicle_late=0.0, wheel_late=0.0, noise=(0.02, 0.01)):
    """Time in s, speeds of vehicle and wheel in m/s and adhesion, [rows].

    Four driven wheelsets pull; the driver changes the notch every 20 s or so, coasts, and brakes by
    the brakes of the wagons; the gradient changes every 60 s. Slip is adhesion / STIFFNESS, and
    in a slip event, one in five minutes, up to 10 % more. The motion is integrated in steps of
    10 ms.
    """
    chance = np.random.default_rng(seed)
    fine = 0.01
    time = np.arange(0.0, seconds + 4.0, fine)
    speed = np.empty_like(time)
    adhesion = np.empty_like(time)
    brake, grade, level, now, held = 0.0, 0.0, 0.1, 15.0, 0.0
    until_notch, until_grade = 0.0, 0.0
    for row, at in enumerate(time):
        if at >= until_notch:
            until_notch = at + chance.uniform(8, 30)
            wanted = 20 - now
            mode = chance.choice(3, p=[0.5, 0.3, 0.2] if wanted > 0 else [0.2, 0.4, 0.4])
            level = chance.uniform(0.05, 0.25) if mode == 0 else 0.0
            brake = chance.uniform(0.1, 0.5) if mode == 2 and now > 8 else 0.0
        if at >= until_grade:
            until_grade, grade = at + chance.uniform(30, 90), chance.uniform(-0.005, 0.005)
        held += fine * np.clip((level - held) / 0.5, -0.2, 0.2)
        adhesion[row] = held
        speed[row] = now
        now += fine * (held * 4 * AXLE * 9.81 / TRAIN - brake - 9.81 * grade - 1e-5 * now**2)
        now = max(now, 3.0)
    slip = adhesion / STIFFNESS
    for begin in chance.uniform(0, seconds, round(seconds / 300)):
        slip += 0.1 * np.exp(-0.5 * ((time - begin) / 1.0) ** 2) * (adhesion > 0.05)
    kept = np.arange(1.0, seconds + 1.0, step)
    wheel = np.interp(kept - wheel_late, time, speed * (1 + slip))
    vehicle = np.interp(kept - vehicle_late, time, speed)
    return (
        kept,
        vehicle + chance.normal(0, noise[0], kept.size),
        wheel + chance.normal(0, noise[1], kept.size),
        np.interp(kept, time, adhesion),
    )
