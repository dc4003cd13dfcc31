"""Frame's rule: the major loop itself, ways that head for the last reversal but one, forgetting."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built
from oracles.loops import followed, frame_rule, outputs
from oracles.relays import way

from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis import FrameRule, midline
from jaxmuscle.hysteresis.frame import DEPTH

RULE = frame_rule()
INPUTS, UP, DOWN = (np.asarray(table) for table in (RULE.inputs, RULE.rising, RULE.falling))


@pytest.mark.slow
def test_goes_round_the_major_loop():
    _, loop = outputs(RULE, -1.5, 1.5, -1.5, samples=120)
    np.testing.assert_allclose(loop[:121], UP, atol=1e-12)
    np.testing.assert_allclose(loop[120:], DOWN[::-1], atol=1e-12)


def test_saturates_outside_the_tables():
    _, loop = outputs(RULE, -1.5, 3.0, 1.2)
    _, inside = outputs(RULE, -1.5, 1.5, 1.2)
    assert loop[40] == pytest.approx(UP[-1])
    assert loop[-1] == pytest.approx(inside[-1], abs=1e-13)


def test_distance_along_the_input_shrinks_linearly_with_the_output():
    rule = frame_rule(2401)
    memory, first = outputs(rule, -1.5, 0.4)
    _, loop = outputs(rule, 0.4, -0.3, memory=memory, samples=400)
    values = way((0.4, -0.3), 400)
    distance = np.interp(loop, rule.falling, rule.inputs) - values
    share = (loop - UP[0]) / (first[-1] - UP[0])
    np.testing.assert_allclose(distance, distance[0] * share, rtol=0, atol=2e-3 * abs(distance[0]))
    assert distance[0] < -0.1


def test_more_reversals_than_it_remembers_cost_only_the_oldest():
    size = np.linspace(1.0, 0.05, DEPTH + 8) * np.resize([1.0, -1.0], DEPTH + 8)
    values = way((-1.5, *size, 1.5), 3)
    _, found = followed(RULE, jnp.asarray(values), RULE.rest())
    assert np.isfinite(found).all()
    assert (found <= UP[-1] + 1e-12).all() and (found >= UP[0] - 1e-12).all()
    assert float(found[-1]) == pytest.approx(UP[-1])


def test_midline_lies_in_the_middle():
    np.testing.assert_allclose(midline(RULE, INPUTS), 0.5 * (UP + DOWN), atol=1e-15)


def test_refuses_a_major_loop_that_is_none():
    with pytest.raises(InputError, match="falling has to increase"):
        built(FrameRule, INPUTS, UP, DOWN[::-1])
    with pytest.raises(InputError, match="three tables of one length"):
        built(FrameRule, INPUTS[1:], UP, DOWN)
