"""A diagnosis printed."""

import dataclasses

import pytest
from report.fake import diagnosis

from jaxmuscle.diagnosis.diagnosis_data import Round
from jaxmuscle.diagnosis.diagnosis_files import _round
from jaxmuscle.report.sentence import indistinguishable


@pytest.mark.parametrize("verdict", ["effects found", "complete", "unexplained"])
def test_printed(verdict):
    """The verdict, what was added, and the errors on unseen data: not the arrays behind them."""
    lines = repr(diagnosis(verdict)).split("\n")
    found = verdict == "effects found"
    assert lines[0] == f"lift: {verdict}" and len(lines) == 1 + found + 1 + 2
    assert (lines[1] == "load_friction: force 16.2 ± 0.4 N") == found
    assert lines[-3].split() == ["error", "on", "unseen", "data", "before", "after", "sensor", "noise"]
    assert {line.split()[0] for line in lines[-2:]} == {"pressure", "position"}


def test_what_does_as_well_alone_may_be_told_apart_beside_what_was_found_later():
    """Alternatives are as the last search says that tried them for the place of the first effect."""
    found = diagnosis("effects found")
    first, *others = found.rounds[0].ranking
    tied = [dataclasses.replace(each, told_apart=False) for each in others]
    alone = dataclasses.replace(found.rounds[0], ranking=(first, *tied))
    known = dataclasses.replace(found, rounds=(alone,))
    assert known.alternatives == tuple(tied) and len(indistinguishable(known)) == len(tied) > 1
    apart = dataclasses.replace(tied[1], told_apart=True)
    beside = Round(2.0, (first, apart), first.name, ("creep",))
    known = dataclasses.replace(found, rounds=(alone, beside))
    assert known.alternatives == (apart, *(each for each in tied if each.name != apart.name))
    assert len(indistinguishable(known)) == len(tied) - 1


def test_a_search_beside_others_is_kept_in_a_file():
    search = dataclasses.replace(diagnosis("effects found").rounds[0], beside=("creep", "gravity"))
    assert _round(dataclasses.asdict(search)) == search
    old = {name: value for name, value in dataclasses.asdict(search).items() if name != "beside"}
    assert _round(old) == dataclasses.replace(search, beside=())
