"""Commands and functions of the library compute on the CPU, whatever else jax finds."""

import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import pytest

from adhesion_jax import keeping, runtime
from adhesion_jax.errors import InputError

#: The second of two CPU devices stands for a GPU that jax would take by itself.
_FLAGS = f"{os.environ['XLA_FLAGS']} --xla_force_host_platform_device_count=2"
_TWO_DEVICES = """
import jax, jax.numpy as jnp
from adhesion_jax import runtime
from adhesion_jax.campaign.keys import noise_keys

cpu, other = jax.devices("cpu")
"""


def done(script, **environment):
    """What the script prints."""
    process = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr
    return process.stdout.split()


@pytest.mark.long
def test_the_library_computes_on_the_cpu_where_jax_prefers_another_device(tmp_path):
    script = f"""{_TWO_DEVICES}
jax.config.update("jax_default_device", other)
here = jax.device_put(jnp.arange(3), cpu)

def where():
    kept = noise_keys(0, "single", jnp.arange(3))
    with runtime.threads() as pool:
        in_threads = pool.map(lambda _: jnp.ones(2).device, range(4))
    return {{jnp.ones(2).device, jax.random.key_data(kept).device, *in_threads}}

assert where() == {{other}}, where()
assert runtime.as_in_commands(where)() == {{cpu}}
assert where() == {{other}}
assert runtime.device() == other
with jax.default_device("cpu"):
    assert runtime.device() == cpu
followed = noise_keys(0, "single", here)  # as by jax.jit
assert jax.random.key_data(followed).device == cpu
print(jax.random.key_data(followed).sum())
"""
    environment = {"XLA_FLAGS": _FLAGS, keeping.VARIABLE: str(tmp_path)}
    compiled = done(script, **environment)
    assert [*tmp_path.rglob("*.program")]
    assert done(script, **environment) == compiled  # now loaded


def test_commands_compute_on_the_cpu_whatever_jax_is_told_or_has_opened():
    told = "from adhesion_jax import runtime; runtime.start(); print(runtime.device().platform)"
    for name in ("JAX_PLATFORMS", "JAX_DEFAULT_DEVICE"):
        assert done(told, **{name: "gpu"}) == ["cpu"]
    opened = f"""{_TWO_DEVICES}
jax.config.update("jax_default_device", other)
runtime.start()
assert jnp.ones(2).device == runtime.device() == cpu
"""
    done(opened, XLA_FLAGS=_FLAGS)


@pytest.mark.parametrize("chosen", ["cuda", None])
def test_a_program_without_the_cpu_is_told_what_to_set(monkeypatch, chosen):
    def none(backend=None):
        raise RuntimeError(f"no {backend}")

    monkeypatch.setattr(jax, "local_devices", none)
    before = jax.config.jax_platforms
    jax.config.update("jax_platforms", chosen)
    try:
        with pytest.raises(InputError, match="has none; set JAX_PLATFORMS to cpu") as refused:
            runtime.as_in_commands(lambda: None)()
    finally:
        jax.config.update("jax_platforms", before)
    assert f"set to compute on {chosen or 'all that it finds'}, has none" in str(refused.value)


def test_a_loop_of_short_steps_is_one_function_of_the_processor():
    """The compiler ignores an option that it does not know: this holds that it knows ours."""

    def step(total, given):
        return 0.9 * total + jnp.sin(given), None

    def over_samples(samples):
        return jax.lax.scan(step, jnp.zeros(samples.shape[1:]), samples)[0]

    compiled = jax.jit(over_samples).lower(jnp.zeros((500, 128))).compile()
    assert "xla_cpu_small_call" in compiled.as_text()


def test_a_program_of_the_calling_thread_has_ended_when_the_call_has():
    """And one of jax has not, so that the test can fail."""

    @jax.jit
    def long(x):
        return jax.lax.fori_loop(0, 30_000, lambda _, x: (x + 2 / x) / 2, jnp.full(2000, x))

    with jax.default_device(runtime.calling_thread()):
        at_once = long(1.0)
        assert at_once.is_ready()
    later = long(1.0)
    assert not later.is_ready()
    assert at_once[0] == later[0] == pytest.approx(2**0.5)
