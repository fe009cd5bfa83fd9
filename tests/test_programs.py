"""Compiled programs that are kept: taken where they are what would be compiled, and only there."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from lanes import lanes

from adhesion_jax import keeping, programs
from adhesion_jax.curves import CURVES
from adhesion_jax.identifiers import IDENTIFIERS

PACKAGE = Path(programs.__file__).parent
NUMBERS = jnp.array([4.0, 9.0])


def root(numbers):
    return jnp.sqrt(numbers)


@pytest.fixture
def store(tmp_path, monkeypatch):
    """An empty folder of programs, and how often one was compiled for it."""
    (tmp_path / "locks").mkdir()
    monkeypatch.setattr(keeping, "_folder", [tmp_path])
    compiled = []
    made = programs._made
    monkeypatch.setattr(programs, "_made", lambda *given: compiled.append(1) or made(*given))
    return tmp_path, compiled


def found(name="root", function=root):
    return np.asarray(programs.program(name, function, NUMBERS)(NUMBERS))


def test_a_program_is_compiled_once_and_then_taken(store):
    folder, compiled = store
    assert found() == pytest.approx([2.0, 3.0])
    assert found() == pytest.approx([2.0, 3.0])
    assert len(compiled) == 1
    assert len([*folder.glob("*.program")]) == 1


def test_a_name_that_does_not_tell_its_content_is_not_kept(store):
    folder, compiled = store
    for _ in range(2):
        assert found(("local", lambda: None)) == pytest.approx([2.0, 3.0])
    assert len(compiled) == 2
    assert not [*folder.glob("*.program")]


def test_a_program_whose_result_would_not_be_found_again_is_not_kept(store):
    """A curve that is a result: a kept program of it ended in a TypeError of its library."""
    folder, compiled = store
    curve = CURVES["burckhardt"]

    def scaled(numbers):
        return jax.tree.map(lambda number: number * numbers[0], curve)

    for _ in range(2):
        made = programs.program("scaled", scaled, NUMBERS)(NUMBERS)
        assert float(made.c1) == pytest.approx(4 * float(curve.c1))
    assert len(compiled) == 2
    assert not [*folder.glob("*.program")]


class Own(eqx.Module):
    """A class of a program that uses the package as a library."""

    factor: float


@pytest.mark.parametrize(
    "part", [*IDENTIFIERS.values(), *CURVES.values()], ids=[*IDENTIFIERS, *CURVES]
)
def test_the_package_tells_its_own_parts(part):
    assert programs.stable_key(("name", jax.tree.structure(part), 1.0)) is not None


def test_a_program_of_a_class_of_the_user_is_not_kept(store):
    """Its name stays where its source changes, and nothing but the name would be seen of it."""
    folder, _ = store
    found(("mine", jax.tree.structure(Own(1.0))))
    found(("mine", Own))
    assert not [*folder.glob("*.program")]


def test_a_file_that_was_named_on_the_command_line_is_told(monkeypatch):
    monkeypatch.setattr(keeping, "_outside", {Path(__file__): b"source"})
    assert programs.stable_key(Own) is not None
    monkeypatch.setattr(keeping, "_outside", {Path(f"{__name__}.py"): b"source"})
    assert programs.stable_key(Own) is not None


def test_a_part_from_outside_that_reads_a_file_gives_new_numbers(store, tmp_path, monkeypatch):
    """Its source stays the same, and so does its name: what it reads is a part of the program."""
    _, compiled = store
    monkeypatch.setattr(keeping, "_outside", {Path(__file__): b"source"})
    file = tmp_path / "gain.txt"
    monkeypatch.setenv("GAIN", "1")

    def asked():
        def scaled(numbers):
            return numbers * float(file.read_text()) * float(os.environ["GAIN"])

        return found(("mine", Own), scaled)

    file.write_text("1.0")
    assert asked() == pytest.approx([4.0, 9.0])
    assert asked() == pytest.approx([4.0, 9.0])
    assert len(compiled) == 1
    file.write_text("1.2")
    assert asked() == pytest.approx([4.8, 10.8])
    monkeypatch.setenv("GAIN", "2")
    assert asked() == pytest.approx([9.6, 21.6])


@pytest.mark.parametrize("damage", ["cut", "flipped", "empty", "another file"])
def test_a_damaged_program_is_compiled_anew(store, damage):
    folder, compiled = store
    found()
    (path,) = folder.glob("*.program")
    whole = path.read_bytes()
    content = {
        "cut": whole[: len(whole) // 2],
        "flipped": whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:],
        "empty": b"",
        "another file": b"no program at all",
    }[damage]
    path.write_bytes(content)
    assert found() == pytest.approx([2.0, 3.0])
    assert len(compiled) == 2
    assert path.read_bytes() != content


def test_what_a_program_depends_on_changes_its_digest(monkeypatch):
    seen = {programs.digest()}
    monkeypatch.setenv("XLA_FLAGS", os.environ["XLA_FLAGS"] + " --xla_cpu_prefer_vector_width=256")
    seen.add(programs.digest())
    with jax.enable_x64(False):
        seen.add(programs.digest())
    monkeypatch.setattr(keeping, "_outside", {})
    for source in (b"x = 1", b"x = 2"):
        keeping.outside(Path("mine.py"), source)
        seen.add(programs.digest())
    monkeypatch.undo()
    jax.config.update("jax_default_matmul_precision", "highest")
    seen.add(programs.digest())
    jax.config.update("jax_default_matmul_precision", None)
    assert len(seen) == 6
    assert programs.digest() in seen


def test_the_programs_used_longest_ago_make_room(store, monkeypatch):
    folder, compiled = store
    for number in range(4):
        found(f"root {number}")
        (new,) = (p for p in folder.glob("*.program") if p.stat().st_mtime > 10 + number)
        os.utime(new, (number, number))
    size = max(path.stat().st_size for path in folder.glob("*.program"))
    found("root 0")  # used again just now
    assert len(compiled) == 4
    monkeypatch.setattr(programs, "MOST_BYTES", 3 * size)
    found("root 4")
    assert sum(path.stat().st_size for path in folder.glob("*.program")) <= 3 * size
    found("root 0")
    assert len(compiled) == 5  # root 0 and root 4 are still there
    found("root 1")
    assert len(compiled) == 6


def test_nothing_is_taken_from_a_folder_that_others_may_write_to(tmp_path, monkeypatch, capsys):
    shared = tmp_path / "shared"
    shared.mkdir()
    shared.chmod(0o777)
    inside = shared / "mine"
    for asked in (shared, inside):
        monkeypatch.setattr(keeping, "_folder", [])
        monkeypatch.setenv(keeping.VARIABLE, str(asked))
        passing = keeping.folder()
        assert shared not in (passing, *passing.parents)
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert f"others may write to {shared}" in told
        assert keeping.VARIABLE in told


def test_a_folder_of_ones_own_is_made_for_oneself_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(keeping, "_folder", [])
    monkeypatch.setenv(keeping.VARIABLE, str(tmp_path / "a" / "b"))
    assert keeping.folder() == tmp_path / "a" / "b"
    assert keeping.folder().stat().st_mode & 0o077 == 0


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="needs another user")
def test_what_another_user_left_in_a_folder_that_was_open_is_not_run(store, monkeypatch):
    """The folder was open, another user put a program there; it is closed now."""
    folder, compiled = store
    found()
    (path,) = folder.glob("*.program")
    (folder / "jax-0").mkdir()
    (folder / "theirs").mkdir()
    planted = [path, folder / "jax-0" / "theirs", folder / "theirs"]
    planted[1].touch()
    path.write_bytes(b"planted")
    for one in planted:
        os.chown(one, 65534, 65534)
    for_all = folder / "jax-0" / "for all"
    for_all.touch()
    for_all.chmod(0o666)
    own = folder / "own.program"
    own.touch()
    keeping._folder.clear()
    monkeypatch.setenv(keeping.VARIABLE, str(folder))
    assert keeping.folder() == folder
    assert own.exists()
    assert not [one for one in (*planted, for_all) if one.exists()]
    found()
    assert len(compiled) == 2


def test_a_program_in_the_place_of_another_one_is_not_run(store):
    folder, compiled = store
    found("first")
    (first,) = folder.glob("*.program")
    found("second")
    (second,) = {*folder.glob("*.program")} - {first}
    second.write_bytes(first.read_bytes())
    found("second")
    assert len(compiled) == 3


def test_programs_may_be_switched_off(tmp_path, monkeypatch):
    monkeypatch.setattr(keeping, "_folder", [])
    monkeypatch.setenv(keeping.VARIABLE, "off")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    found()
    assert not [*tmp_path.iterdir()]


@pytest.mark.usefixtures("store")
def test_a_kept_function_is_part_of_the_program_around_it():
    @programs.kept(static=(1,))
    def power(x, exponent):
        return x**exponent

    assert power(NUMBERS, 2) == pytest.approx([16.0, 81.0])
    assert power(NUMBERS, 3) == pytest.approx([64.0, 729.0])
    assert power(2.0, 3) == pytest.approx(8.0)  # another kind of argument
    assert jax.jit(lambda x: power(x, 2) + 1)(NUMBERS) == pytest.approx([17.0, 82.0])
    assert jax.vmap(jax.grad(lambda x: power(x, 2)))(NUMBERS) == pytest.approx([8.0, 18.0])


_SCRIPT = """
import sys, jax.numpy as jnp
from adhesion_jax import programs, runtime
runtime.start()
programs.share_with_jax()

def inverse(matrices):
    return jnp.linalg.inv(matrices) @ jnp.sort(jnp.sin(matrices), axis=1)

made = programs._made
def counted(*given):
    print("compiled")
    return made(*given)
programs._made = counted
matrix = jnp.eye(3) + 0.1 * jnp.arange(9.0).reshape(3, 3)
print(programs.program("inverse", inverse, matrix)(matrix).sum())
"""


def run_script(environment, script=_SCRIPT, folder=None):
    return subprocess.Popen(
        [sys.executable, "-c", script],
        env={**os.environ, **environment},
        cwd=folder,
        stdout=subprocess.PIPE,
        text=True,
    )


def lines_of(process):
    output, _ = process.communicate()
    assert process.returncode == 0
    return output.split()


@pytest.mark.long
def test_a_program_that_jax_has_kept_itself_works_in_the_next_process(tmp_path):
    """With jax 0.10 what is loaded and written once more lacks some of its functions."""
    named = {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "jax")}
    named |= {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    first, second = (
        {keeping.VARIABLE: str(tmp_path / "a")},
        {keeping.VARIABLE: str(tmp_path / "b")},
    )
    (*_, expected) = lines_of(run_script(named | first))
    assert lines_of(run_script(named | second)) == ["compiled", expected]
    assert lines_of(run_script(named | second)) == [expected]


@pytest.mark.long
def test_two_processes_at_once_compile_a_program_once(tmp_path):
    environment = {keeping.VARIABLE: str(tmp_path)}
    together = [run_script(environment) for _ in range(2)]
    told = [lines_of(process) for process in together]
    assert sorted(map(len, told)) == [1, 2]
    assert told[0][-1] == told[1][-1]


@pytest.mark.parametrize("with_jax", lanes([True, False], always=0, thorough=1))
def test_an_edited_method_gives_new_numbers_at_once(tmp_path, with_jax):
    """Parameters times 1.05 are a bias of mu_max of 5 %, whatever was compiled before."""
    shutil.copytree(PACKAGE, tmp_path / "adhesion_jax")
    environment = {keeping.VARIABLE: str(tmp_path / "cache"), "PYTHONPATH": str(tmp_path)}
    if with_jax:
        environment |= {"JAX_COMPILATION_CACHE_DIR": str(tmp_path / "jax")}

    def bias():
        asked = "montecarlo --scenario single --identifiers ml-exact --runs 100"
        command = "import sys\nfrom adhesion_jax.command_line.program import main\n"
        command += f"sys.argv[1:] = {asked.split()}\nmain()\n"
        lines_of(run_script(environment, command, tmp_path))
        summary = pd.read_csv(tmp_path / "out" / "montecarlo" / "summary.csv")
        row = summary[summary["quantity"] == "mu_max"].iloc[0]
        return row["bias"] / row["truth"]

    assert abs(bias()) < 1e-3
    method = tmp_path / "adhesion_jax" / "identifiers" / "ml_exact.py"
    before = "jnp.stack([found.a, found.nu, found.b])"
    assert before in method.read_text()
    method.write_text(
        method.read_text().replace(before, f"{before} * jnp.array([1.05, 1.0, 1.05])")
    )
    assert bias() == pytest.approx(0.05, abs=1e-3)


@pytest.mark.usefixtures("store")
def test_an_option_that_this_compiler_does_not_have_is_left_out():
    """jaxlib 0.11 has none of the fusion emitters, which 0.10 has."""
    options = {**programs.QUICKLY, "xla_cpu_option_of_another_version": True}
    made = programs.program(jnp.exp, jnp.exp, 0.0, options)
    assert float(made(0.0)) == 1.0


_ARCTANGENTS = """
import jax.numpy as jnp, numpy as np
from adhesion_jax import programs, runtime
runtime.start()
many = jnp.linspace(-3.0, 3.0, 1024)

def inverse(numbers):
    return jnp.arctan(numbers) + jnp.arctan2(numbers, jnp.ones_like(numbers))

found = programs.program("arctangents", inverse, many, programs.WIDELY)(many)
print(np.abs(np.asarray(found) - 2 * np.arctan(np.linspace(-3.0, 3.0, 1024))).max() < 1e-14)
"""


def test_arctangents_are_right_in_wide_vectors(tmp_path):
    """Those of jaxlib 0.10.2 are not, in vectors of 512 bits by the fusion emitters."""
    environment = {keeping.VARIABLE: str(tmp_path), "XLA_FLAGS": ""}
    assert lines_of(run_script(environment, _ARCTANGENTS)) == ["True"]
