"""A sample of one axle of the HXD1F, as seekers and controllers are given it."""

import jax.numpy as jnp

from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.signals import Reference, Signals

PLANT = read_plant(shipped()["hxd1f"]).plant


def signals_of(slip, adhesion, torque=None, wanted=0.1):
    """At 5 m/s; without a torque it holds the load of the adhesion."""
    slip, adhesion, wanted = (
        jnp.reshape(jnp.asarray(one, dtype=float), 1) for one in (slip, adhesion, wanted)
    )
    load, speed = PLANT.load_of(adhesion), jnp.asarray(5.0)
    return Signals(
        time=jnp.asarray(0.0),
        demand=jnp.full(1, 13e3),
        motor_speed=PLANT.gear_ratio * (speed + slip) / PLANT.radius,
        train_speed=speed,
        slip=slip,
        torque=load if torque is None else jnp.reshape(jnp.asarray(torque, dtype=float), 1),
        load=load,
        adhesion=adhesion,
        slip_beside=slip,
        optimum=None,
        reference=Reference(wanted, jnp.zeros(1)),
    )
