"""Which of two diagnoses counts, where the later one leaves as much of the reading of which most is left."""

from types import SimpleNamespace
from typing import Any

import pytest

from jaxmuscle.diagnosis.passes import _better

WITHOUT = {"position": 2.4, "pressure": 1.9}


def diagnosis(left, names=(), alone=True):
    """What it leaves of each reading [noise], with effects that are told apart from others or not."""
    entries = [SimpleNamespace(judged=True, told_apart=each) for each in (False, True, alone)]
    found: Any = SimpleNamespace(
        added=[SimpleNamespace(name=name) for name in names],
        rounds=[SimpleNamespace(added=names, ranking=entries)] if names else [],
        after={"training": {column: SimpleNamespace(in_noise=each) for column, each in left.items()}},
        missing_in_noise=(max(left.values()) ** 2 - 1) ** 0.5,
        typical_error=2.0,
        share_left=1.0,
    )
    return found


@pytest.mark.parametrize(
    ("left", "alone", "counts"),
    [
        ({"position": 2.3, "pressure": 1.2}, True, True),
        ({"position": 2.3, "pressure": 1.2}, False, False),
        ({"position": 2.41, "pressure": 1.2}, True, False),
        ({"position": 2.3, "pressure": 1.8}, True, False),
    ],
)
def test_an_effect_counts_that_clears_a_reading_of_which_less_was_left(left, alone, counts):
    """Slow noise of a position stays; an offset of the valve was refused that explains the pressure."""
    assert _better(diagnosis(left, ("valve_offset",), alone), diagnosis(WITHOUT)) == counts


def test_it_does_not_count_before_what_was_found():
    second = diagnosis({"position": 2.3, "pressure": 1.2}, ("valve_offset",))
    assert not _better(second, diagnosis(WITHOUT, ("chamber_leak",)))


def test_a_reading_within_its_noise_is_not_cleared():
    second = diagnosis({"position": 2.4, "pressure": 0.9}, ("valve_offset",))
    assert not _better(second, diagnosis({"position": 2.4, "pressure": 1.3}))
