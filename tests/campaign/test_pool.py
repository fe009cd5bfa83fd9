"""Work mapped over processes."""

import os
import sys
import time

import click
import pytest

from adhesion_jax.campaign.pool import Processes
from adhesion_jax.command_line.command import run
from adhesion_jax.errors import InputError, WorkerError


def found(function, work, workers=2):
    with Processes(workers).mapped(function, work) as results:
        return list(results)


def squared(number):
    return number**2, os.getpid()


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_work(workers):
    results = found(squared, [(number,) for number in range(20)], workers)
    assert [number for number, _ in results] == [number**2 for number in range(20)]
    here = {process for _, process in results} == {os.getpid()}
    assert here == (workers == 1)


def later(number, folder):
    """The first unit ends after another one."""
    deadline = time.monotonic() + 60
    while number == 0 and not [*folder.iterdir()] and time.monotonic() < deadline:
        time.sleep(0.01)
    (folder / str(number)).touch()
    return number


@pytest.mark.long
def test_a_result_waits_for_those_before_it_where_their_order_matters(tmp_path):
    folders = [tmp_path / "mapped", tmp_path / "stored"]
    for folder in folders:
        folder.mkdir()
    assert found(later, [(number, folders[0]) for number in range(9)]) == [*range(9)]
    with Processes(2).stored(later, [(number,) for number in range(9)], folders[1]) as results:
        ended = [*results]
    assert sorted(ended) == [*range(9)]
    assert ended[0] != 0


def refused(number):
    raise InputError(f"{number} is not wanted.")


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_of_a_unit_is_raised_here(workers):
    with pytest.raises(InputError, match=r"^7 is not wanted\."):
        found(refused, [(7,), (7,)], workers)


def noted(number, folder):
    """Ends its process whenever it is 7, while 1 is still computed; notes that it was tried."""
    with (folder / f"{number}").open("a") as tries:
        tries.write("x")
    if number == 1:
        time.sleep(0.5)
    if number == 7:
        os._exit(9)
    return number


@pytest.mark.long
def test_a_unit_that_ends_its_process_is_tried_three_times_and_finished_ones_once(
    tmp_path, monkeypatch, capsys
):
    results = []

    @click.command()
    def command():
        work = [(number,) for number in range(40)]
        dies = pytest.raises(WorkerError)
        with dies as died, Processes(2).stored(noted, work, tmp_path) as ended:
            results.extend(ended)
        raise died.value

    monkeypatch.setattr(sys, "argv", ["command"])
    with pytest.raises(SystemExit) as left:
        run(command)
    assert left.value.code == 1
    told = capsys.readouterr().err
    assert told.startswith("error: a worker process was killed")
    assert "3 times at the same piece" in told
    assert "Traceback" not in told
    tries = {int(path.name): len(path.read_text()) for path in tmp_path.iterdir()}
    assert tries[7] >= 3
    assert {*range(7)} <= {*results}
    assert len(results) == len({*results})


def weighed(content):
    return content * 2


@pytest.mark.long
def test_large_units_and_large_results_do_not_wait_for_each_other():
    work = [(bytes([number]) * 2_000_000,) for number in range(12)]  # more than a line holds
    assert found(weighed, work) == [content * 2 for (content,) in work]


def killed_at_first(number, folder):
    """Ends its process at the first try of every third unit."""
    mark = folder / str(number)
    if number % 3 == 0 and not mark.exists():
        mark.touch()
        os._exit(9)
    return number


@pytest.mark.long
def test_the_units_of_a_worker_that_dies_are_tried_again(tmp_path):
    assert found(killed_at_first, [(number, tmp_path) for number in range(4)]) == [*range(4)]


def slow(number):
    time.sleep(0 if number == 0 else 600)
    return os.getpid()


@pytest.mark.long
def test_no_process_goes_on_after_the_work_is_given_up():
    with Processes(2).mapped(slow, [(number,) for number in range(4)]) as results:
        process = next(results)
    with pytest.raises(ProcessLookupError):
        os.kill(process, 0)
