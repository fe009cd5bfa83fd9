"""Every guarded number stands where it is said to, and a test that sees a change is told apart."""

import py_compile
from pathlib import Path

import pytest

from experiments.mutations import ROOT, copied, mutations, outcome, status_of

MUTATIONS = mutations()


def test_eleven_and_forty_numbers_are_guarded():
    assert len(MUTATIONS) > 11 + 40


@pytest.mark.parametrize("name", MUTATIONS)
def test_the_number_stands_there_once_and_the_test_is_there(name):
    one = MUTATIONS[name]
    assert (ROOT / one.file).read_text(encoding="utf-8").count(one.text) == 1
    assert one.becomes != one.text
    file, _, test = one.test.partition("::")
    assert f"\ndef {test.partition('[')[0]}(" in (ROOT / file).read_text(encoding="utf-8")


def test_a_number_that_is_changed_kills_its_test_and_a_comment_does_not(tmp_path):
    """And bytecode of the number as it was, whose source Python does not look at, is gone."""
    bins = MUTATIONS["bins"]
    copy = copied(tmp_path / "copy")
    module = copy / bins.file
    source = module.read_text(encoding="utf-8")
    assert status_of(copy, [bins.test]) == 0
    unchecked = py_compile.PycInvalidationMode.UNCHECKED_HASH
    bytecode = py_compile.compile(str(module), invalidation_mode=unchecked)
    assert outcome(copy, bins) == "killed"
    assert not Path(bytecode).exists()
    assert module.read_text(encoding="utf-8") == source
    assert outcome(copy, bins._replace(becomes=f"{bins.text}  # of a bin")) == "survived"
    assert outcome(copy, bins._replace(text="WIDTH = 7")) == "stale"
