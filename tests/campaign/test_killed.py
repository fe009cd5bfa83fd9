"""Jobs that are killed, and what is left of them: run as a user runs them, in processes."""

import json
import os
import pty
import random
import re
import resource
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import pandas as pd
import pytest

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/task").exists(), reason="it looks for processes"
)

#: 28 shards.
JOB = ("montecarlo", "--scenario", "single", "--identifiers", "ml-exact,gn-jaxopt", "--points", 60)
RUNS = 5000

#: Two shards without noise, and 12 of 32 runs.
TRACTION = ("traction", "--system", "uyulan2018", "--step", "2e-4", "--runs", 32)


def begun(out, *more, limit=None, job=(*JOB, "--runs", RUNS), stderr=subprocess.PIPE):
    """A job on its way; its files may have no more than `limit` bytes."""
    command = (sys.executable, "-m", "adhesion_jax", *job, "--out", out)
    # A process that is started where Ctrl-C is ignored ignores it too.
    answer = signal.signal(signal.SIGINT, signal.SIG_DFL)
    job = subprocess.Popen(
        [*map(str, command), *map(str, more)],
        stderr=stderr,
        stdout=subprocess.DEVNULL,
        text=True,
        cwd=Path(__file__).parents[2],
        start_new_session=True,
    )
    signal.signal(signal.SIGINT, answer)
    if limit is not None:
        resource.prlimit(job.pid, resource.RLIMIT_FSIZE, (limit, limit))
    return job


def ended(job):
    """Its exit status, and what it said without the progress."""
    _, said = job.communicate(timeout=300)
    return job.returncode, said.replace("\r", "\n")


def shards(out):
    return len([*(out / "shards").glob("*.npz")])


def wait_for(job, out, number):
    """Until so many shards are there, or the job has ended."""
    while shards(out) < number and job.poll() is None:
        time.sleep(0.01)


def children(process):
    told = Path(f"/proc/{process}/task/{process}/children").read_text()
    return [*map(int, told.split())]


def alive(processes):
    """Those of some processes that run, zombies that nobody has collected apart."""
    states = []
    for pid in processes:
        status = Path(f"/proc/{pid}/status")
        if status.exists():
            states += [line for line in status.read_text().splitlines() if line[:6] == "State:"]
    return [state for state in states if "zombie" not in state]


def wait_for_end(processes):
    deadline = time.monotonic() + 10
    while alive(processes) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not alive(processes)


def results(out):
    """The tables without times, and the rows."""
    found = {path.name: pd.read_csv(path) for path in out.glob("*.csv")}
    for name, table in found.items():
        found[name] = table.drop(columns=[column for column in table if "seconds" in column])
    return {**found, "runs": pd.read_parquet(out / "runs.parquet")}


def assert_same(one, other):
    assert one.keys() == other.keys()
    for name, table in one.items():
        pd.testing.assert_frame_equal(table, other[name], check_exact=True)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The results of a job that nothing interrupts."""
    out = tmp_path_factory.mktemp("whole")
    assert ended(begun(out))[0] == 0
    return results(out)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.thorough
def test_a_job_that_is_killed_again_and_again_gives_the_same_results(whole, tmp_path, seed):
    random.seed(seed)
    killed = 0
    while True:
        job = begun(tmp_path, "--resume")
        wait_for(job, tmp_path, shards(tmp_path) + random.randrange(20))
        time.sleep(random.uniform(0, 0.3))
        workers = children(job.pid) if job.poll() is None else []
        job.kill()
        status, said = ended(job)
        wait_for_end(workers)
        if status == 0:
            break
        assert status == -signal.SIGKILL, said
        killed += 1
    assert killed > 0
    assert_same(results(tmp_path), whole)
    assert {path.name for path in (tmp_path / "shards").iterdir()} >= {"job.json", ".lock"}
    assert not [*tmp_path.rglob(".partial-*")]


@pytest.mark.thorough
def test_another_process_takes_the_place_of_a_worker_that_is_killed(whole, tmp_path):
    job = begun(tmp_path)
    wait_for(job, tmp_path, 2)
    os.kill(max(children(job.pid)), signal.SIGKILL)
    status, said = ended(job)
    assert status == 0, said
    assert_same(results(tmp_path), whole)


def read_all(terminal):
    """What is shown until the other end is closed."""
    shown = b""
    while True:
        try:
            shown += os.read(terminal, 2**16)
        except OSError:
            return shown.decode().replace("\r", "\n")


@pytest.mark.thorough
def test_how_far_a_job_is_is_shown_on_a_terminal_alone(tmp_path):
    assert ended(begun(tmp_path)) == (0, "")
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 200))
    many = 8 * RUNS  # for seconds, since it is looked every half a second at what is done
    job = begun(tmp_path, job=(*JOB, "--runs", many), stderr=theirs)
    os.close(theirs)
    shown = read_all(ours)
    os.close(ours)
    assert job.wait() == 0
    counts = [int(count) for count in re.findall(rf"(\d+)/{many} ", shown)]
    assert counts == sorted(counts)
    assert counts[-1] == many
    assert "workers: " in shown
    assert "ml-exact on single" in shown


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.thorough
def test_a_job_that_is_stopped_leaves_its_shards_and_nothing_else(whole, tmp_path, number):
    job = begun(tmp_path)
    wait_for(job, tmp_path, 3)
    workers = children(job.pid)
    job.send_signal(number)
    status, said = ended(job)
    assert status == 128 + number
    assert "Traceback" not in said
    assert f"of {RUNS} runs are finished and stay in" in said
    wait_for_end(workers)
    assert [path.name for path in tmp_path.iterdir()] == ["shards"]
    assert not [*tmp_path.rglob(".partial-*")]
    assert ended(begun(tmp_path, "--resume"))[0] == 0
    assert_same(results(tmp_path), whole)


@pytest.mark.thorough
def test_a_full_disk_is_answered_in_a_sentence_and_finished_shards_stay(whole, tmp_path):
    """A limit to the size of a file stands for it: later shards are larger than the first."""
    job = begun(tmp_path, limit=30_000)
    status, said = ended(job)
    assert status == 2, said
    assert "Traceback" not in said
    assert "cannot be written to (File too large)" in said
    assert shards(tmp_path) > 0
    assert [path.name for path in tmp_path.iterdir()] == ["shards"]
    assert not [*tmp_path.rglob(".partial-*")]
    assert ended(begun(tmp_path, "--resume"))[0] == 0
    assert_same(results(tmp_path), whole)


@pytest.mark.thorough
def test_two_jobs_in_one_folder(whole, tmp_path):
    first = begun(tmp_path)
    wait_for(first, tmp_path, 1)
    first.send_signal(signal.SIGSTOP)  # so that it does not end before the second begins
    status, said = ended(begun(tmp_path))
    first.send_signal(signal.SIGCONT)
    assert status == 2
    assert "is being written to by another job" in said
    assert ended(first)[0] == 0
    assert_same(results(tmp_path), whole)


@pytest.mark.thorough
def test_runs_are_added_and_the_state_is_told(whole, tmp_path):
    fewer = (*JOB, "--runs", 3000)
    job = begun(tmp_path, job=fewer)
    wait_for(job, tmp_path, 2)
    job.kill()
    ended(job)
    told = subprocess.run(
        [sys.executable, "-m", "adhesion_jax", "status", str(tmp_path)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        check=True,
    ).stdout
    assert "of 3000 runs are finished" in told
    assert "no job is computing" in told
    assert "ml-exact" in told
    assert ended(begun(tmp_path, "--resume", job=fewer))[0] == 0
    assert ended(begun(tmp_path, "--extend", RUNS - 3000))[0] == 0
    assert_same(results(tmp_path), whole)
    assert json.loads((tmp_path / "metadata.json").read_text())["config"]["runs"] == RUNS


@pytest.mark.slow
def test_a_traction_job_survives_what_a_campaign_does(tmp_path):
    """Killed, without a worker, stopped, on a full disk, and beside another job."""
    whole, again = tmp_path / "whole", tmp_path / "again"
    assert ended(begun(whole, job=TRACTION))[0] == 0
    again.mkdir()

    job = begun(again, job=TRACTION, limit=20_000)  # the drawn runs are larger
    status, said = ended(job)
    assert status == 2, said
    assert "cannot be written to (File too large)" in said

    job = begun(again, "--resume", job=TRACTION)
    wait_for(job, again, 3)
    workers = children(job.pid)
    job.kill()
    ended(job)
    wait_for_end(workers)

    job = begun(again, "--resume", job=TRACTION)
    wait_for(job, again, 5)
    status, said = ended(begun(again, "--resume", job=TRACTION))
    assert status == 2
    assert "is being written to by another job" in said
    os.kill(max(children(job.pid)), signal.SIGKILL)
    wait_for(job, again, 7)
    workers = children(job.pid)
    job.send_signal(signal.SIGTERM)
    status, said = ended(job)
    assert status == 128 + signal.SIGTERM, said
    assert "runs are finished and stay in" in said
    wait_for_end(workers)
    assert [path.name for path in again.iterdir()] == ["shards"]
    assert not [*again.rglob(".partial-*")]

    shard = min((again / "shards").glob("*.npz"))
    shard.write_bytes(shard.read_bytes()[:1000])
    assert ended(begun(again, "--resume", job=TRACTION))[0] == 0
    assert_same(results(again), results(whole))
