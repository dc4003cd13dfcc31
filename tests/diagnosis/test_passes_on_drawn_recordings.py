"""Passes of a diagnosis on drawn recordings that one pass is not enough for."""

import importlib
import sys
from pathlib import Path

import pytest

import jaxmuscle as jm
from jaxmuscle.effects import (
    ChamberLeak,
    DeadVolume,
    LengthHysteresis,
    SupplyDroop,
    ThreadFriction,
)

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
from blind_recordings import drawn  # pyright: ignore[reportMissingImports]

module = importlib.import_module("jaxmuscle.diagnosis.diagnose")


def sought_among(monkeypatch, usual, rarer=()):
    """Let diagnoses try these effects alone."""
    monkeypatch.setattr(module, "CATALOGUE", tuple(usual))
    monkeypatch.setattr(module, "EXTENSION", tuple(rarer))
    monkeypatch.setattr(module, "reading_effects", lambda rig: ())


def beginning(blind, share=0.5):
    """So much of the recording from its first sample on, where that shows enough: it takes less time."""
    return blind.recording.part(0, round(share * len(blind.recording)))


@pytest.mark.thorough
def test_a_drooping_supply_is_found_behind_the_states_that_windows_begin_with(monkeypatch):
    """Readings, given the others, leave only noise; predictions from the command are far off."""
    sought_among(monkeypatch, [ChamberLeak], [SupplyDroop, DeadVolume])
    blind = drawn(110281, "isotonic", 1, False)
    assert {*blind.truth} == {"supply_droop"}
    found = jm.diagnose(beginning(blind), constants=False)
    assert [effect.name for effect in found.effects] == ["supply_droop"]
    (droop,) = found.effects
    resistance = droop.parameters["resistance"]
    assert abs(resistance.value - blind.truth["supply_droop"]["resistance"]) < 2 * resistance.std
    assert found.after["held_out"]["position"].in_noise < 2.0 < found.before["held_out"]["position"].in_noise


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("seed", "most"),
    # Bristles that leave less than the law may leave are found only where all effects are tried.
    [(122088, 1.5), (122148, 4.0)],
)
def test_what_the_law_of_a_rough_thread_leaves_is_no_other_effect(seed, most, monkeypatch):
    """It is some hundredths of the friction; a hysteresis of the muscle's length was named beside it."""
    sought_among(monkeypatch, [ThreadFriction, LengthHysteresis])
    blind = drawn(seed, "driven", 1, False)
    assert {*blind.truth} == {"thread_friction"} and blind.bristles > 0
    found = jm.diagnose(beginning(blind), constants=False)
    first, *further = (effect.name for effect in found.effects)
    assert first == "thread_friction" and {*further} <= {"presliding"}
    assert found.after["held_out"]["force"].in_noise < most < 30 < found.before["held_out"]["force"].in_noise


@pytest.mark.slow
def test_what_bent_friction_leaves_is_not_said_to_go_with_the_velocity():
    """A joint without its gravity is given more friction than it has, 116 noise units off."""
    blind = drawn(300002, "joint", 1, False, ("gravity",))
    found = jm.diagnose(beginning(blind), catalogue=[ChamberLeak], constants=False)
    assert found.verdict == "unexplained"
    (left,) = found.unexplained
    assert left.signal == "load" and left.rms_in_noise > 50
    assert "angular_velocity" not in left.depends_on
