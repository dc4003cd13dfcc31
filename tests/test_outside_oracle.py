"""Causes outside the catalogue, as the oracles have them, held against values by hand."""

from math import pi

import numpy as np
import pytest
from oracles.driven import driven
from oracles.isotonic import isotonic
from oracles.sensors import readings
from test_oracles import AMBIENT, HELD, LIFT, MUSCLE, STEP, lifted, turned


def test_pushes_from_outside_by_hand():
    t = np.arange(200) * 0.01
    p, x, v = np.full(200, AMBIENT + 3e5), 0.02 + 0.01 * np.sin(t), 0.01 * np.cos(t)
    still = driven(MUSCLE, {}, p, x, v)

    def added(name, **parameters):
        return driven(MUSCLE, {name: parameters}, p, x, v) - still

    cogs = added("cogging", force=5.0, pitch=8e-3)
    np.testing.assert_allclose(cogs, 5 * np.sin(2 * pi * x / 8e-3), atol=1e-9)
    np.testing.assert_allclose(added("air_drag", coefficient=400.0), -400 * v * np.abs(v), atol=1e-9)
    shaken = added("shaking", force=3.0, frequency=2.0)
    np.testing.assert_allclose(shaken, 3 * np.sin(4 * pi * t), atol=1e-9)
    weight = added("added_weight", force=7.0, time=0.995)
    np.testing.assert_allclose(weight, np.where(np.arange(200) < 100, 0.0, -7.0), atol=1e-9)


def test_pushes_from_outside_move_the_load():
    """A weight that is there from the beginning stretches a held muscle as the same mass does, in a joint
    as gravity on a link that hangs sideways.
    """
    filled, damped = np.where(np.arange(600) < 60, 5.0, 0.0), {"load_damping": {"coefficient": 800.0}}
    weight = {"added_weight": {"force": 3 * 9.80665, "time": 0.0}}
    one = lifted(damped | weight, filled)[1][-1]
    assert one == pytest.approx(lifted(damped, filled, card=LIFT | {"mass": 15.0})[1][-1], rel=1e-3)
    assert one < 0.99 * lifted(damped, filled)[1][-1]
    held = np.full((500, 2), AMBIENT + 3e5)
    damped = {"load_damping": {"coefficient": 0.5}}
    turned_by = {"added_weight": {"force": 0.2, "time": 0.0}}
    angle = turned(damped | turned_by, held)[2][-1]
    sideways = {"gravity": {"torque": 0.2, "hanging_angle": angle - 0.5 * pi}}
    assert angle == pytest.approx(turned(damped | sideways, held)[2][-1], rel=1e-4) and angle < -1e-3


def test_a_chamber_follows_a_supply_that_swings():
    slow = {"supply_swing": {"share": 0.1, "frequency": 0.25}}
    pressure, *_ = isotonic(HELD | {"valve_area": 2e-5}, slow, np.full(1500, 5.0), STEP, AMBIENT, 12)
    supply = LIFT["supply_pressure"] * (1 + 0.1 * np.sin(0.5 * pi * STEP * np.arange(1500)))
    np.testing.assert_allclose(pressure[500::100], supply[500::100], rtol=5e-3)


def test_misreadings_by_hand():
    value = np.linspace(0.0, 4.0, 5)

    def read(name, **parameters):
        own = {name: {"column": "position", **parameters}}
        shown = readings(own, {"position": value, "force": value}, 0.5)
        np.testing.assert_array_equal(shown["force"], value)
        return shown["position"] - value

    ripple = read("reading_ripple", size=0.1, pitch=3.0)
    np.testing.assert_allclose(ripple, 0.1 * np.sin(2 * pi * value / 3), atol=1e-12)
    hum = read("hum", size=0.2, frequency=0.3)
    np.testing.assert_allclose(hum, 0.2 * np.sin(0.3 * pi * np.arange(5)), atol=1e-12)
    np.testing.assert_allclose(read("zero_jump", size=-0.3, time=0.9), [0, 0, -0.3, -0.3, -0.3])
