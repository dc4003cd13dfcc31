"""Which effects are tried, and where their fits begin."""

import numpy as np
import pytest
from oracles import bench

from jaxmuscle.diagnosis.candidates import (
    MULTIPLES,
    OPPOSITE,
    carries_state,
    linear_strength,
    loaded,
    missing,
    paths_of,
    shapes,
    strengths,
)
from jaxmuscle.effects import BY_NAME, CATALOGUE
from jaxmuscle.parameters import get


def problem(seed, free=3, samples=80):
    rng = np.random.default_rng(seed)
    return rng.normal(size=samples), rng.normal(size=(free, samples)), rng.normal(size=samples)


def cost(residual, slopes):
    """Solution and sum of squares of the best linear step along `slopes`."""
    step = np.linalg.lstsq(slopes.T, -residual, rcond=None)[0]
    return step, float(((residual + step @ slopes) ** 2).sum())


@pytest.mark.parametrize("seed", range(4))
def test_linear_strength_is_least_squares(seed):
    residual, free, direction = problem(seed)
    strength, gain = linear_strength(residual, free, direction)
    _, without = cost(residual, free)
    step, whole = cost(residual, np.vstack([free, direction]))
    assert strength == pytest.approx(step[-1], rel=1e-9)
    assert gain == pytest.approx(1 - whole / without, rel=1e-9)


def test_linear_strength_of_what_made_the_residual():
    _, free, direction = problem(9)
    strength, gain = linear_strength(0.3 * free[0] - 2.5 * direction, free, direction)
    assert strength == pytest.approx(2.5)
    assert gain == pytest.approx(1.0)


def test_direction_that_the_free_parameters_have_already():
    residual, free, _ = problem(2)
    assert linear_strength(residual, free, 0.7 * free[0] - free[2]) == (0.0, 0.0)
    assert linear_strength(residual, free, np.zeros_like(residual)) == (0.0, 0.0)


def test_missing_are_offered_and_not_declared():
    model = bench.model("driven", thread_friction=bench.THREADS)
    names = {effect.name for effect in missing(model, CATALOGUE)}
    assert names == {effect.name for effect in bench.offered("driven")} - {"thread_friction"}
    assert "bladder_stiffness" in names
    assert not names & {"chamber_leak", "command_delay", "load_friction"}
    assert missing(model, [BY_NAME["chamber_leak"], BY_NAME["creep"]]) == [BY_NAME["creep"]]


def test_loaded_carries_all_at_zero_strength():
    model = bench.model("isotonic", load_friction={"force": 7.0})
    candidates = missing(model, CATALOGUE)
    carrying = loaded(model, candidates)
    assert set(carrying.effects) == {"load_friction", *(effect.name for effect in candidates)}
    assert float(get(carrying, "effects.load_friction.force")) == 7.0
    for effect in candidates:
        assert float(get(carrying, f"effects.{effect.name}.{effect.strength}")) == 0.0
        assert all(path.startswith(f"effects.{effect.name}.") for path in paths_of(carrying, effect.name))


def test_strengths_are_multiples_of_the_estimate():
    path = "effects.load_friction.force"
    found = list(strengths(BY_NAME["load_friction"], {}, -4.0, nonnegative=True))
    assert found == [{path: multiple * 4.0} for multiple in MULTIPLES]
    signed = list(strengths(BY_NAME["bladder_stiffness"], {}, -4.0, nonnegative=False))
    both = (*MULTIPLES, *OPPOSITE)
    assert signed == [{"effects.bladder_stiffness.stiffness": -multiple * 4.0} for multiple in both]


@pytest.mark.parametrize("name", ["thread_friction", "command_delay"])
def test_shapes_that_give_the_strength_are_taken_as_they_are(name):
    effect = BY_NAME[name]
    found = [start for shape in shapes(effect) for start in strengths(effect, shape, 1e3, nonnegative=True)]
    assert found == [{f"effects.{name}.{k}": v for k, v in s.items()} for s in effect.starts]


def test_every_shape_with_every_multiple():
    effect = BY_NAME["gravity"]
    found = [start for shape in shapes(effect) for start in strengths(effect, shape, 2.0, nonnegative=False)]
    strength, shape = f"effects.gravity.{effect.strength}", "effects.gravity.hanging_angle"
    assert [(s[shape], s[strength]) for s in found] == [
        (given["hanging_angle"], multiple * 2.0)
        for given in effect.starts
        for multiple in (*MULTIPLES, *OPPOSITE)
    ]


def test_effects_with_a_state_of_their_own():
    names = {effect.name for effect in CATALOGUE if carries_state(effect)}
    assert names == {"length_hysteresis", "creep", "force_sensor_lag"}
