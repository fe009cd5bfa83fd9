"""Work mapped over processes."""

import os
import sys

import click
import pytest

from adhesion_jax.campaign.executor import mapped
from adhesion_jax.command_line.command import run
from adhesion_jax.errors import WorkerError


def squared(number):
    return number**2, os.getpid()


def killed(status):
    os._exit(status)


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_work(workers):
    with mapped(squared, [(number,) for number in range(20)], workers) as results:
        found = list(results)
    assert [number for number, _ in found] == [number**2 for number in range(20)]
    here = {process for _, process in found} == {os.getpid()}
    assert here == (workers == 1)


def test_a_worker_that_dies_is_told_in_a_sentence(monkeypatch, capsys):
    dies = pytest.raises(WorkerError, match="was killed, or had no memory left")
    with dies, mapped(killed, [(9,), (9,)], 2) as results:
        list(results)

    @click.command()
    def command():
        with mapped(killed, [(9,), (9,)], 2) as results:
            list(results)

    monkeypatch.setattr(sys, "argv", ["command"])
    with pytest.raises(SystemExit) as left:
        run(command)
    assert left.value.code == 1
    told = capsys.readouterr().err
    assert told.startswith("error: a worker process was killed")
    assert "Traceback" not in told


def weighed(content):
    return content * 2


def test_large_units_and_large_results_do_not_wait_for_each_other():
    work = [(bytes([number]) * 2_000_000,) for number in range(12)]  # more than a line holds
    with mapped(weighed, work, 2) as results:
        assert list(results) == [content * 2 for (content,) in work]


def killed_at_first(number, folder):
    """Ends its process at the first try of every third unit."""
    mark = folder / str(number)
    if number % 3 == 0 and not mark.exists():
        mark.touch()
        os._exit(9)
    return number


def test_the_units_of_a_worker_that_dies_are_tried_again(tmp_path):
    with mapped(killed_at_first, [(number, tmp_path) for number in range(7)], 2) as results:
        assert list(results) == [*range(7)]
