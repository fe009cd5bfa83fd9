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
