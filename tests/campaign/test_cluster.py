"""Work mapped over the workers of a Dask cluster, with the results of one process."""

import errno
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from adhesion_jax import keeping
from adhesion_jax.campaign import cluster, store
from adhesion_jax.campaign import pool as pool_module
from adhesion_jax.campaign.cluster import pool_of, versions
from adhesion_jax.campaign.pool import Processes
from adhesion_jax.campaign.traction import content, job_of
from adhesion_jax.command_line.montecarlo import main
from adhesion_jax.errors import InputError, WorkerError
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import with_parts
from experiments.claims.traction import plant_of

distributed = pytest.importorskip("distributed")

HOME = Path(__file__).parents[2]

#: Twelve shards.
JOB = ("--scenario", "single", "--identifiers", "ml-exact,gn-jaxopt", "--points", "60")
RUNS = 1500

IDENTIFIER = """
from adhesion_jax.identifiers.ml_exact import ExactMaximumLikelihood

class Mine(ExactMaximumLikelihood):
    pass

mine = Mine()
"""


def squared(number, _):
    return number**2, os.getpid()


def killed(*_):
    os.kill(os.getpid(), signal.SIGKILL)


def killed_once(path, _):
    """Ends its process the first time that it is called, and then never again."""
    try:
        path.touch(exist_ok=False)
    except FileExistsError:
        return "done"
    os.kill(os.getpid(), signal.SIGKILL)
    return None


def written_up_to(number, folder):
    """Ends with an error at 60."""
    if number == 60:
        raise InputError("60 is not wanted.")
    return written(number, folder)


def squared_or_killed_once(number, path, folder):
    if number == 100:
        killed_once(path, folder)
    return number**2


def refused(number, _):
    raise InputError(f"{number} is not wanted.")


def without_space(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def written(number, folder):
    (folder / f"{number}.txt").write_text(str(number))
    return folder


@pytest.fixture(scope="module")
def two():
    with pool_of(1, "local:2") as pool:
        yield pool


@pytest.fixture(scope="module")
def scheduler(two):
    """The address of its scheduler, to join."""
    return two.client.scheduler.address


def found(pool, function, arguments, folder):
    with pool.stored(function, [(one,) for one in arguments], folder) as results:
        return list(results)


def test_without_a_cluster_it_is_so_many_processes():
    with pool_of(3, None) as pool:
        assert pool == Processes(3)


@pytest.mark.long
def test_every_unit_has_its_result_once_from_two_processes(two, tmp_path):
    results = found(two, squared, range(60), tmp_path)
    assert sorted(number for number, _ in results) == [number**2 for number in range(60)]
    processes = {process for _, process in results}
    assert len(processes) == 2
    assert os.getpid() not in processes
    assert two.workers == 2


@pytest.mark.long
def test_no_more_units_are_given_out_than_memory_is_meant_for(two, tmp_path, monkeypatch):
    monkeypatch.setattr(pool_module, "_GIVEN_OUT", 8)
    given, submit = [], two.client.submit

    def noted(*arguments, **named):
        given.append(named["key"])
        return submit(*arguments, **named)

    monkeypatch.setattr(two.client, "submit", noted)
    with two.stored(squared, [(number,) for number in range(40)], tmp_path) as results:
        for ended, _ in enumerate(results, 1):
            assert len(given) - ended <= 8
    assert len({*given}) == 40


@pytest.mark.long
def test_only_what_is_not_done_is_cancelled(two, tmp_path, monkeypatch):
    cancelled = []
    monkeypatch.setattr(two.client, "cancel", cancelled.append)
    found(two, squared, range(9), tmp_path)
    assert not cancelled
    with two.stored(squared, [(number,) for number in range(200)], tmp_path) as results:
        next(results)
    assert 0 < len(cancelled.pop()) < 200
    assert not cancelled


@pytest.mark.long
def test_an_error_of_a_unit_is_raised_here(two, tmp_path):
    with pytest.raises(InputError, match=r"^7 is not wanted\."):
        found(two, refused, [7], tmp_path)
    with pytest.raises(OSError, match="No space left on device"):  # no loss of the connection
        found(two, without_space, [7], tmp_path)


@pytest.mark.long
def test_what_is_finished_before_an_error_is_kept(two, tmp_path):
    ended = []
    wanted = pytest.raises(InputError, match=r"^60 is not wanted\.")
    work = [(number,) for number in range(200)]
    with wanted, two.stored(written_up_to, work, tmp_path) as results:
        ended += results
    names = {path.name for path in tmp_path.iterdir()}
    assert len(ended) >= 30
    assert names == {path.name for path in tmp_path.glob("*.txt")}
    assert len(names) == len(ended)


@pytest.mark.long
def test_a_worker_that_dies_costs_none_of_the_other_units(two, tmp_path):
    work = [(number, tmp_path / "died") for number in range(200)]
    with two.stored(squared_or_killed_once, work, tmp_path) as results:
        assert sorted(results) == [number**2 for number in range(200)]
    assert (tmp_path / "died").exists()


@pytest.mark.thorough
def test_a_worker_that_dies_is_replaced_and_its_unit_tried_again(two, tmp_path):
    paths = [tmp_path / "a", tmp_path / "b"]
    assert found(two, killed_once, paths, tmp_path) == ["done", "done"]


@pytest.mark.thorough
def test_a_unit_whose_worker_dies_three_times_is_told_in_a_sentence(two, tmp_path):
    with pytest.raises(WorkerError, match="or had no memory left, 3 times at the same piece"):
        found(two, killed, [0], tmp_path)
    assert [number for number, _ in found(two, squared, [3], tmp_path)] == [9]


@pytest.mark.long
def test_files_come_to_the_folder_that_is_asked_for(scheduler, tmp_path):
    with pool_of(1, scheduler) as pool:
        places = found(pool, written, range(9), tmp_path)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        f"{number}.txt": str(number) for number in range(9)
    }
    assert not any(place.is_relative_to(tmp_path) for place in places)
    assert not any(place.exists() for place in places)


@pytest.mark.thorough
def test_parts_in_files_of_the_users_own_are_used_in_workers(scheduler, tmp_path):
    path = tmp_path / "own.py"
    path.write_text(IDENTIFIER)
    command = (sys.executable, "-m", "experiments.montecarlo", "--scenario", "single")
    command += ("--identifiers", f"{path}:mine", "--runs", "300", "--points", "60")
    where = ("--out", str(tmp_path / "out"), "--cluster", scheduler)
    done = subprocess.run([*command, *where], capture_output=True, text=True, cwd=HOME)
    assert done.returncode == 0, done.stderr
    summary = pd.read_csv(tmp_path / "out" / "summary.csv")
    assert set(summary["identifier"]) == {"mine"}


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "other"), [("python", "3.0.1"), ("jax", "0.1"), ("source of adhesion-jax", "ab12")]
)
def test_a_worker_of_another_version_is_refused(scheduler, monkeypatch, name, other):
    mine = dict(versions())
    monkeypatch.setattr(cluster, "versions", lambda: tuple({**mine, name: other}.items()))
    sentence = rf"The worker tcp://\S+ has {name} {mine[name]}, and this machine has {other};"
    with pytest.raises(InputError, match=sentence), pool_of(1, scheduler):
        pass


@pytest.mark.long
def test_a_worker_with_several_threads_is_refused():
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=2, dashboard_address="127.0.0.1:0", memory_limit=0
        ) as started,
        pytest.raises(InputError, match=r"has 2 threads.*start it with --nthreads 1"),
        pool_of(1, started.scheduler_address),
    ):
        pass


def test_a_scheduler_without_workers_is_refused(monkeypatch):
    monkeypatch.setattr(cluster, "_PATIENCE", 1)
    with (
        distributed.LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0") as started,
        pytest.raises(InputError, match="has no workers; start some by"),
        pool_of(1, started.scheduler_address),
    ):
        pass


def test_an_address_without_a_scheduler_is_refused_and_nothing_removed(monkeypatch, tmp_path):
    monkeypatch.setattr(cluster, "_PATIENCE", 1)
    (tmp_path / "shards").mkdir()
    (tmp_path / "shards" / "job.json").write_text("{}")
    with pytest.raises(InputError, match=r"--cluster tcp://127\.0\.0\.1:1 cannot be reached"):
        main([*JOB, "--cluster", "tcp://127.0.0.1:1", "--out", str(tmp_path)], "montecarlo")
    assert (tmp_path / "shards" / "job.json").read_text() == "{}"


@pytest.mark.parametrize(
    "text",
    ["local", "local:0", "local:two", "local:-1", "tcp://host", "host:8786", "tcp://h:99999"],
)
def test_what_is_no_cluster_is_refused(text):
    with pytest.raises(InputError, match=f"--cluster {text} is no cluster; give local:N"):
        main(["--cluster", text], "montecarlo")


def test_without_dask_it_is_said_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'adhesion-jax\[cluster\]'"):
        main(["--cluster", "local:2"], "montecarlo")
    with pytest.raises(InputError, match="is not installed"), pool_of(1, "local:2"):
        pass


def begun(out, *more, cores=None):
    """A job on its way, on these cores or on those of this process."""
    runs = () if "--runs" in more else ("--runs", RUNS)
    command = (sys.executable, "-m", "experiments.montecarlo", *JOB, *runs, "--out", out)
    answer = signal.signal(signal.SIGINT, signal.SIG_DFL)
    own = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores or own)  # a child has those of its parent
    job = subprocess.Popen(
        [*map(str, command), *map(str, more)],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        cwd=HOME,
        env={**os.environ, "TMPDIR": str(passing(out))},
        start_new_session=True,
    )
    os.sched_setaffinity(0, own)
    signal.signal(signal.SIGINT, answer)
    return job


def passing(out):
    """Where a job has what passes with it."""
    place = out.parent / f"{out.name}-tmp"
    place.mkdir(exist_ok=True)
    return place


def ended(job):
    """Its exit status, and what it said without the progress."""
    _, said = job.communicate(timeout=300)
    return job.returncode, said.replace("\r", "\n")


def wait_for(job, out, number):
    """Until so many shards are there, or the job has ended."""
    while len([*(out / "shards").glob("*.npz")]) < number and job.poll() is None:
        time.sleep(0.01)


def group(job):
    """The processes of a job that run, by their command lines."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            state, _, of_group = (path / "stat").read_text().rpartition(")")[2].split()[:3]
            words = (path / "cmdline").read_text().replace("\0", " ")
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(of_group) == job.pid and state != "Z":
            found[int(path.name)] = words
    return found


def assert_nothing_runs(job):
    deadline = time.monotonic() + 10
    while group(job) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not group(job)


def tables(out):
    """The tables without times, the rows, and what each shard adds up to without times."""
    found = {}
    for path in out.glob("*.csv"):
        table = pd.read_csv(path)
        found[path.name] = table.drop(columns=[name for name in table if "seconds" in name])
    shards = {}
    for path in sorted((out / "shards").glob("*.npz")):
        with np.load(path) as stored:
            shards[path.name] = {n: stored[n].tobytes() for n in stored if "seconds" not in n}
        rows = path.with_suffix(".parquet")
        shards[rows.name] = rows.read_bytes()
    return {**found, "runs": pd.read_parquet(out / "runs.parquet")}, shards


def assert_same(one, other):
    for name, table in one[0].items():
        pd.testing.assert_frame_equal(table, other[0][name], check_exact=True)
    assert one[1] == other[1]


#: Jobs are looked at as processes.
of_processes = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="it needs /proc")


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The results of a job in one process."""
    out = tmp_path_factory.mktemp("alone") / "out"
    assert ended(begun(out, cores={min(os.sched_getaffinity(0))}))[0] == 0
    return tables(out)


@of_processes
@pytest.mark.thorough
@pytest.mark.parametrize("pool", ["processes", "local", "joined"])
def test_every_pool_gives_the_same_bits(alone, scheduler, tmp_path, pool):
    options = {
        "processes": (),
        "local": ("--cluster", "local:2"),
        "joined": ("--cluster", scheduler),
    }
    out = tmp_path / "out"
    status, said = ended(begun(out, *options[pool]))
    assert status == 0, said
    assert_same(tables(out), alone)
    assert not [*passing(out).iterdir()]


@pytest.mark.thorough
def test_traction_in_shards_gives_the_same_bits_on_a_cluster(two, tmp_path):
    system = SYSTEMS["hxd1f"]._replace(duration=0.1)
    cases = with_parts(system.cases(system.step), "full-dimension", "constant-slip", "barrier")
    job = job_of("hxd1f", system, cases, plant_of(system), runs=3)
    work = [(job, number) for number in range(job.shards)]
    folders = [tmp_path / "here", tmp_path / "there"]
    for pool, folder in zip([Processes(1), two], folders, strict=True):
        folder.mkdir()
        with pool.stored(partial(store.stored, content), work, folder) as results:
            assert sorted(results) == sorted(job.runs_of(number) for _, number in work)
    one, other = (
        pd.concat(store.rows_of(f, job.name, n).to_pandas() for _, n in work) for f in folders
    )
    pd.testing.assert_frame_equal(one, other, check_exact=True)
    assert {path.name for path in folders[0].iterdir()} == {p.name for p in folders[1].iterdir()}


@of_processes
@pytest.mark.thorough
def test_a_worker_of_a_cluster_that_is_killed_costs_only_time(alone, tmp_path):
    out = tmp_path / "out"
    job = begun(out, "--cluster", "local:2")
    wait_for(job, out, 2)
    workers = [pid for pid, words in group(job).items() if "spawn_main" in words]
    os.kill(workers[0], signal.SIGKILL)
    status, said = ended(job)
    assert status == 0, said
    assert_same(tables(out), alone)


@of_processes
@pytest.mark.thorough
def test_a_job_on_a_cluster_is_resumed_after_its_client_is_killed(alone, tmp_path):
    of_workers, out = keeping.folder() / "dask", tmp_path / "out"
    before = set(of_workers.glob("*/worker-*"))
    job = begun(out, "--cluster", "local:2")
    wait_for(job, out, 3)
    job.kill()
    assert ended(job)[0] == -signal.SIGKILL
    assert_nothing_runs(job)
    status, said = ended(begun(out, "--cluster", "local:2", "--resume"))
    assert status == 0, said
    assert_same(tables(out), alone)
    assert not [*out.rglob(".partial-*")]
    assert not [*passing(out).iterdir()]
    assert set(of_workers.glob("*/worker-*")) == before


@of_processes
@pytest.mark.thorough
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_job_on_a_cluster_that_is_stopped_leaves_its_shards_alone(tmp_path, number):
    out = tmp_path / "out"
    job = begun(out, "--runs", 20000, "--cluster", "local:2")
    wait_for(job, out, 3)
    os.killpg(job.pid, number)  # as a terminal does
    status, said = ended(job)
    assert status == 128 + number
    assert "Traceback" not in said
    assert "of 20000 runs are finished and stay in" in said
    assert_nothing_runs(job)
    assert [path.name for path in out.iterdir()] == ["shards"]
    assert not [*out.rglob(".partial-*")]
    assert not [*passing(out).iterdir()]


@of_processes
@pytest.mark.thorough
def test_a_scheduler_that_dies_is_told_in_a_sentence(tmp_path):
    out = tmp_path / "out"
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0", memory_limit=0
    ) as started:
        job = begun(out, "--runs", 50000, "--cluster", started.scheduler_address)
        wait_for(job, out, 3)
    status, said = ended(job)
    assert status == 1
    assert "error: the connection to the cluster was lost" in said
    assert "of 50000 runs are finished and stay in" in said
    assert "Traceback" not in said
