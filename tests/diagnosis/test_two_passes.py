"""A diagnosis among the usual effects, and among all where these leave something."""

import dataclasses
import importlib
from typing import Any

import pytest

from jaxmuscle.diagnosis.diagnose import LESS, _in_two_passes
from jaxmuscle.diagnosis.verdict import MUCH
from jaxmuscle.effects import CATALOGUE, EXTENSION

module = importlib.import_module("jaxmuscle.diagnosis.diagnose")


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What of a diagnosis decides."""

    missing_in_noise: float
    added: tuple[str, ...] = ()
    share_left: float = 1.0
    seconds: float = 10.0
    declared: Any = None


def passes(*outcomes):
    """The outcome, and with what each pass was asked to choose from."""
    asked, left = [], list(outcomes)

    def seek(catalogue):
        asked.append(catalogue)
        return left.pop(0)

    return _in_two_passes(seek)(), asked


@pytest.fixture(autouse=True)
def _no_sensors(monkeypatch):
    monkeypatch.setattr(module, "reading_effects", lambda rig: ("sensor_offset",))


def test_the_usual_effects_are_enough_where_they_leave_nothing():
    found, asked = passes(Outcome(MUCH, ("creep",)))
    assert found.added == ("creep",) and asked == [CATALOGUE]


def test_a_little_of_much_is_no_reason_to_go_on():
    found, asked = passes(Outcome(4.6, ("thread_friction",), share_left=0.14))
    assert found.added == ("thread_friction",) and asked == [CATALOGUE]


def test_all_are_tried_where_something_is_left():
    found, asked = passes(Outcome(9.0, ("command_delay",)), Outcome(0.2, ("dead_band",)))
    assert found.added == ("dead_band",) and found.seconds == 20.0
    assert asked == [CATALOGUE, (*CATALOGUE, *EXTENSION, "sensor_offset")]


@pytest.mark.parametrize("second", [Outcome(9.0 * LESS + 0.1, ("backlash",)), Outcome(0.1)])
def test_more_effects_that_leave_as_much_do_not_count(second):
    found, _ = passes(Outcome(9.0, ("command_delay",)), second)
    assert found.added == ("command_delay",) and found.seconds == 20.0
