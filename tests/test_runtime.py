"""Commands and functions of the library compute on the CPU, whatever else jax finds."""

import os
import subprocess
import sys

import jax
import pytest

from adhesion_jax import runtime
from adhesion_jax.errors import InputError

#: The second of two CPU devices stands for a GPU that jax would take by itself.
_HOST = """
import jax, jax.numpy as jnp
from adhesion_jax import runtime
from adhesion_jax.programs import kept

cpu, other = jax.devices()
jax.config.update("jax_default_device", other)

@kept()
def twice(x):
    return 2 * x

def where():
    with runtime.threads() as pool:
        in_threads = pool.map(lambda _: jnp.ones(2).device, range(4))
    return {jnp.ones(2).device, twice(jnp.ones(2)).device, *in_threads}

assert where() == {other}, where()
assert runtime.as_in_commands(where)() == {cpu}
assert where() == {other}
assert runtime.device() == other
with jax.default_device("cpu"):
    assert runtime.device() == cpu
"""


def test_the_library_computes_on_the_cpu_where_jax_prefers_another_device():
    flags = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count=2"
    done = subprocess.run(
        [sys.executable, "-c", _HOST],
        env={**os.environ, "XLA_FLAGS": flags},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_commands_compute_on_the_cpu_whatever_the_environment_says():
    script = "from adhesion_jax import runtime; runtime.start(); print(runtime.device().platform)"
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, "JAX_PLATFORMS": "cuda"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["cpu"], done.stderr


def test_a_program_without_the_cpu_is_told_what_to_set(monkeypatch):
    def none(backend=None):
        raise RuntimeError(f"no {backend}")

    monkeypatch.setattr(jax, "local_devices", none)
    before = jax.config.jax_platforms
    jax.config.update("jax_platforms", "cuda")
    try:
        with pytest.raises(InputError, match=r"on cuda alone.*set JAX_PLATFORMS to cuda,cpu"):
            runtime.as_in_commands(lambda: None)()
    finally:
        jax.config.update("jax_platforms", before)
