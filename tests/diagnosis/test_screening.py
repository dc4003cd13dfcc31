"""What each candidate may remove of an error, told from residuals alone."""

import numpy as np
import pytest
from oracles.recorded import driven_card, driven_recording

from jaxmuscle.diagnosis.candidates import missing
from jaxmuscle.diagnosis.folds import STEPS
from jaxmuscle.diagnosis.forward_selection import forward_selection
from jaxmuscle.diagnosis.screening import _projected, _slope, parts_removed
from jaxmuscle.diagnosis.workbench import workbench
from jaxmuscle.effects import BladderStiffness, Creep, PressureDependentEnds, ThreadFriction
from jaxmuscle.estimation.case import case
from jaxmuscle.progress import Meter

THREADS = {"static_coefficient": 0.015, "kinetic_coefficient": 0.08, "velocity_constant": 0.15}
STIFF = {"stiffness": 400.0, "threshold_pressure": 5e4}
CANDIDATES = (BladderStiffness, Creep, PressureDependentEnds, ThreadFriction)


@pytest.mark.slow
def test_beside_one_effect_of_two_the_other_promises_most():
    """Threads that rub, screened beside the bladder that was found first, and none beside both."""
    prepared = case(
        driven_recording({"bladder_stiffness": STIFF, "thread_friction": THREADS}, driven_card({}), seed=6),
        0.3,
        None,
    )
    bench = workbench(prepared, missing(prepared.actuator, CANDIDATES))
    selection = forward_selection(prepared, bench, Meter(lambda progress: None))
    accepted, parts = ["bladder_stiffness"], []
    for others in (CANDIDATES[1:], CANDIDATES[1:3]):
        dressed = bench.dressed(selection.model, accepted)
        present = bench.settled(dressed, accepted, selection.parts, STEPS)
        parts.append(parts_removed(bench, accepted, others, selection.parts, present))
        accepted.append("thread_friction")
    assert parts[0][2] > 0.2 and max(parts[0][:2]) < 0.02
    assert max(parts[1]) < 0.02


@pytest.mark.parametrize("size", [1e3, 1.0, 1e-7])
def test_the_slope_over_a_strength_is_found_whatever_its_size(size):
    direction = np.linspace(0.5, 1.0, 20)
    none = np.cos(np.arange(20.0))
    slope = _slope(lambda strength: none + np.tanh(strength / size) * direction, none, 1.0)
    np.testing.assert_allclose(slope, direction / size, rtol=5e-3)
    assert _projected(none, direction) == pytest.approx(-(direction @ none) / (direction @ direction))
    assert _projected(none, 0 * direction) == 0.0
