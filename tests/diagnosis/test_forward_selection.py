"""What the search of a diagnosis begins with: parts of windows on which candidates are judged."""

import dataclasses

import pytest

import jaxmuscle as jm
from jaxmuscle.diagnosis.forward_selection import ALL_PARTS, PARTS, SHORTEST, parts_of_a_window


@pytest.mark.parametrize("windows", [4, 5, 30])
def test_many_windows_are_cut_into_four_parts(windows: int) -> None:
    assert parts_of_a_window(windows, 5000) == PARTS


@pytest.mark.parametrize("windows", [1, 2, 3])
def test_few_windows_are_cut_into_enough_parts_for_a_test_of_signs(windows: int) -> None:
    parts = parts_of_a_window(windows, 5000)
    assert ALL_PARTS <= windows * parts < ALL_PARTS + windows


def test_parts_keep_so_many_samples_that_errors_have_time_to_grow() -> None:
    assert parts_of_a_window(1, 10 * SHORTEST) == 10
    assert parts_of_a_window(1, PARTS * SHORTEST - 1) == PARTS
    assert parts_of_a_window(0, 5000) == ALL_PARTS, "a recording without a training window is told elsewhere"


@pytest.mark.slow
def test_a_whole_run_is_diagnosed_on_its_parts() -> None:
    """Without a horizon a recording has one training window, which by itself tells no effect from chance."""
    lift = jm.read(jm.sample("lift"))
    whole = dataclasses.replace(lift, card=dataclasses.replace(lift.card, horizon=None))
    found = jm.diagnose(whole)
    assert found.settings["windows"] - found.settings["held_out_windows"] == 1
    (friction,) = found.effects
    assert found.verdict == "effects found" and friction.name == "load_friction"
    assert PARTS < friction.stretches <= ALL_PARTS
    assert found.after["held_out"]["position"].in_noise < 1.2
