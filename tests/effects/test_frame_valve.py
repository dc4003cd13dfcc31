"""Frame's rule as an effect of the jet pipe: its loop, what it is by the rule alone, its derivative."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.effects import CATALOGUE, FrameValveHysteresis
from jaxmuscle.effects.valve import LOOP_SHARE, major_loop
from jaxmuscle.hysteresis import respond
from jaxmuscle.recordings.schema import quantities
from jaxmuscle.signals import Signals

PIPE = bench.model("jet-pipe").pipe
SPAN, WIDTH = 0.7784, 8e-5


@jax.jit
def additions(way, half_width=WIDTH):
    """What the effect adds along a way of tip forces, as fractions of the span."""
    effect = bench.built(FrameValveHysteresis, half_width)

    def onward(memory, current):
        here = Signals(pipe=PIPE, current=current)
        return effect.update(memory, here, jnp.asarray(1e-3)), effect.value(memory, here)

    currents = jnp.asarray(way) * SPAN / PIPE.force_constant
    return jax.lax.scan(onward, effect.initial(Signals(pipe=PIPE, current=currents[0])), currents)[1]


def way(*corners):
    legs = np.linspace(0, len(corners) - 1, 240, endpoint=False)
    return np.interp(legs, np.arange(len(corners)), corners)


@pytest.mark.slow
def test_major_loop_is_as_wide_as_declared():
    path = way(-1.0, 1.0, -1.0)
    ends = WIDTH * (1 - path**2) * np.where(np.arange(len(path)) < 120, -1, 1)
    np.testing.assert_allclose(additions(path), ends, atol=1e-3 * WIDTH)


@pytest.mark.slow
def test_minor_loops_are_those_of_the_rule():
    path = way(-1.0, 0.6, -0.3, 0.2, -0.8, 1.2, 0.0)
    rule = np.asarray(respond(major_loop(), np.clip(path, -1, 1))[1])
    expected = WIDTH * (rule - np.clip(path, -1, 1)) / LOOP_SHARE
    np.testing.assert_allclose(additions(path), expected, atol=1e-12)


@pytest.mark.slow
def test_strength_scales_it_and_zero_is_nothing():
    path = way(-1.0, 0.6, -0.3, 0.2)
    assert not np.any(additions(path, 0.0))
    slope = jax.jacfwd(lambda w: additions(path, w))(jnp.asarray(0.0))
    np.testing.assert_allclose(slope * WIDTH, additions(path), rtol=1e-12)


@pytest.mark.slow
def test_it_runs_in_the_actuator():
    actuator = bench.model("jet-pipe")
    with_rule = actuator.with_effects(valve_hysteresis_by_frame=bench.built(FrameValveHysteresis, WIDTH))
    t = np.arange(60) * bench.STEPS["jet-pipe"]
    track = bench.track("jet-pipe", 1.0 + 0.3 * np.sin(2 * np.pi * 20 * t))
    bare, ruled = (bench.simulated(m, track, 1).readings["force"] for m in (actuator, with_rule))
    # Coming from below, the tip lags behind and the jet feeds less into chamber 1.
    assert float(ruled[-1]) < float(bare[-1]) - 1.0 and float(ruled[0]) == pytest.approx(float(bare[0]))


def test_a_card_may_declare_it_and_a_diagnosis_does_not_seek_it():
    assert FrameValveHysteresis not in CATALOGUE
    numbers, rig = bench.CARDS["jet-pipe"], RIGS["jet-pipe"]
    needs = quantities(rig)
    known = {
        name: {"value": float(value), "unit": needs[name].unit}
        | ({"reference": "absolute"} if needs[name].referenced else {})
        for name, value in numbers.items()
    }
    columns = {
        name: {"column": name, "unit": unit}
        for name, unit in {"time": "s", "command": "V", "current": "A", "force": "N"}.items()
    }
    effect = {"valve_hysteresis_by_frame": {"half_width": {"value": 0.08, "unit": "mm"}}}
    card = jm.Card.parse({"rig": "jet-pipe", "columns": columns, "known": known, "effects": effect})
    declared = jm.actuator(card).effects["valve_hysteresis_by_frame"]
    assert isinstance(declared, FrameValveHysteresis)
    assert float(declared.half_width) == pytest.approx(WIDTH) and float(declared.span) == pytest.approx(SPAN)
