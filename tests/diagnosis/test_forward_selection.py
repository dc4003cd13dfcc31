"""What the search of a diagnosis begins with: parts of windows on which candidates are judged."""

import dataclasses

import pytest

import jaxmuscle as jm
from jaxmuscle.diagnosis.folds import FOLDS
from jaxmuscle.diagnosis.forward_selection import (
    ALL_PARTS,
    PARTS,
    SHORTEST,
    forward_selection,
    parts_of_a_window,
)
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.estimation.case import case
from jaxmuscle.progress import Meter


@pytest.mark.parametrize("windows", [4, 5, 30])
def test_many_windows_are_cut_into_four_parts(windows: int) -> None:
    assert parts_of_a_window(windows, 5000) == PARTS


@pytest.mark.parametrize("windows", [1, 2, 3])
def test_few_windows_are_cut_into_enough_parts_for_a_test_of_signs(windows: int) -> None:
    parts = parts_of_a_window(windows, 5000)
    assert ALL_PARTS <= windows * parts < ALL_PARTS + windows


def test_parts_keep_so_many_samples_that_errors_have_time_to_grow() -> None:
    assert parts_of_a_window(1, 10 * SHORTEST) == 10
    assert parts_of_a_window(30, PARTS * SHORTEST - 1) == PARTS - 1
    assert parts_of_a_window(30, 11) == 1, "a short window is not cut"
    assert parts_of_a_window(30, 50, imposed=True) == PARTS, "nothing has to grow"
    assert parts_of_a_window(1, 11) == FOLDS, "every fold has a part"
    assert parts_of_a_window(0, 5000) == ALL_PARTS, "a recording without a training window is told elsewhere"


@pytest.mark.slow
def test_nothing_is_tried_where_all_that_is_left_waits_for_something_else() -> None:
    """A rig with few effects came to the end of them and stopped with an error."""
    prepared = case(jm.read(jm.sample("lift")).part(0, 2000), 0.3)
    bench = workbench(prepared, [], refinements=[jm.effects.Presliding], rivals=[jm.effects.SupplyDroop])
    selection = forward_selection(prepared, bench, Meter(lambda progress: None))
    assert bench.worst_mean_square(selection.model, selection.training) > 2
    selection.seek()
    assert not selection.names and not selection.rounds


@pytest.fixture(scope="module")
def whole_run() -> jm.Recording:
    """Without a horizon a recording has one training window."""
    lift = jm.read(jm.sample("lift"))
    return dataclasses.replace(lift, card=dataclasses.replace(lift.card, horizon=None))


@pytest.mark.slow
def test_a_search_of_whole_windows_has_a_part_for_each_fold(whole_run: jm.Recording) -> None:
    """A fold without a part to be judged by stopped the diagnosis of a coil muscle's only run."""
    prepared = case(whole_run, 0.3)
    assert len(prepared.training.rows) == 1
    bench = workbench(prepared, [jm.effects.LoadFriction])
    selection = forward_selection(prepared, bench, Meter(lambda progress: None))
    selection.seek(whole=True)
    assert int(selection.parts.period) == -(-prepared.training.samples // FOLDS)
    assert selection.names == ["load_friction"]


@pytest.mark.slow
def test_a_whole_run_is_diagnosed_on_its_parts(whole_run: jm.Recording) -> None:
    """One window by itself tells no effect from chance."""
    some = (jm.effects.Creep, jm.effects.LoadDamping, jm.effects.LoadFriction)
    found = jm.diagnose(whole_run, catalogue=some)
    assert found.settings["windows"] - found.settings["held_out_windows"] == 1
    (friction,) = found.effects
    assert found.verdict == "effects found" and friction.name == "load_friction"
    assert PARTS < friction.stretches <= ALL_PARTS
    assert found.after["held_out"]["position"].in_noise < 1.2
