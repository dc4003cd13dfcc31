"""Isotonic contraction: the closed forms of [T] against the rig, and the paper's three loads."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from scipy.optimize import root_scalar

from jaxmuscle.actuators.isotonic import STANDARD_GRAVITY
from jaxmuscle.components.mckibben import isotonic_contraction, largest_contraction, lift_off_pressure
from jaxmuscle.parameters import replace

CASES = [(30.0, 4e5), (20.0, 3e5), (10.0, 2e5)]
"""[T] figure 12: mass [kg] (the first digit of the first is unsure), gauge pressure [Pa]."""
MUSCLE = bench.model("isotonic").muscle
STATIC = bench.THREADS["static_coefficient"]


@cache
def lifted(mass, gauge, rubbing=True):
    """Gauge pressure and position every 0.5 ms while a supply at `gauge` fills the muscle; 2.5 s."""
    declared = {"thread_friction": bench.THREADS} if rubbing else {}
    actuator = replace(
        bench.model("isotonic", **declared),
        {"mass": mass, "valve.supply_pressure": bench.AMBIENT + gauge, "valve.area": 1.5e-6},
    )
    track = bench.isotonic_track(np.full(5000, 5.0))
    track = bench.Track(jnp.asarray(5e-4), track.command, track.measured)
    out = bench.simulated(actuator, track, 1).readings
    return np.asarray(out["pressure"]) - bench.AMBIENT, np.asarray(out["position"])


def balance(position, gauge, mass, friction):
    """F_dyn - m g at the point of standing still after a contraction."""
    x = jnp.asarray(position)
    force = MUSCLE.force(x, jnp.asarray(gauge), MUSCLE.end_factor)
    return float(force - friction * MUSCLE.contact_surface(x) * gauge - mass * STANDARD_GRAVITY)


@pytest.mark.parametrize("rubbing", [True, False])
@pytest.mark.parametrize(("mass", "gauge"), CASES)
def test_lifts_off_at_the_pressure_of_the_closed_form(mass, gauge, rubbing):
    pressure, position = lifted(mass, gauge, rubbing)
    # Above what rounding moves a mass that dry friction holds.
    first = np.flatnonzero(position > 1e-9)[0]
    expected = float(
        lift_off_pressure(MUSCLE, jnp.asarray(mass * STANDARD_GRAVITY), jnp.asarray(STATIC * rubbing))
    )
    # It lies between the samples before and at which the mass is seen to have left.
    assert pressure[first - 2] <= expected <= pressure[first]
    assert pressure[first] - pressure[first - 2] < 0.06 * expected
    assert balance(0.0, expected, mass, STATIC * rubbing) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("mass", "gauge"), CASES)
def test_comes_to_rest_where_static_friction_meets_the_force(mass, gauge):
    _, position = lifted(mass, gauge)
    ends = (0.0, float(largest_contraction(MUSCLE)))
    rest = root_scalar(balance, args=(gauge, mass, STATIC), bracket=ends).root
    assert position[-1] == pytest.approx(rest, rel=2e-3)
    # Without friction it would come to the closed form, further up.
    free = float(isotonic_contraction(MUSCLE, jnp.asarray(mass * STANDARD_GRAVITY), jnp.asarray(gauge)))
    assert rest < free < float(largest_contraction(MUSCLE))
    assert balance(free, gauge, mass, 0.0) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("mass", "gauge"), CASES)
def test_contraction_takes_some_tenths_of_a_second_and_is_damped(mass, gauge):
    # [T], the two dynamic properties read off figure 12.
    _, position = lifted(mass, gauge)
    travel = position[-1]
    rise = (np.argmax(position > 0.9 * travel) - np.argmax(position > 0.1 * travel)) * 5e-4
    assert 0.1 < rise < 1.0
    assert position.max() < 1.01 * travel
    # The friction does it: without it the mass swings.
    bare = lifted(mass, gauge, False)[1]
    assert bare.max() > 1.03 * float(
        isotonic_contraction(MUSCLE, jnp.asarray(mass * STANDARD_GRAVITY), jnp.asarray(gauge))
    )


def test_more_force_while_lengthening_than_while_contracting():
    # [T] 17: the loop is 2 f S P wide.
    actuator = bench.model("driven", thread_friction=bench.THREADS)
    forces = []
    for velocity in (0.05, -0.05):
        track = bench.driven_track(np.full(3, bench.AMBIENT + 3e5), np.full(3, 0.03), np.full(3, velocity))
        forces.append(float(bench.simulated(actuator, track, 1).readings["force"][0]))
    f = 0.105 - 0.09 * np.exp(-0.05 / 0.15)
    surface = float(MUSCLE.contact_surface(jnp.asarray(0.03)))
    assert forces[1] - forces[0] == pytest.approx(2 * f * surface * 3e5, rel=1e-12)


def test_fitted_friction_is_the_handbook_value_over_thirteen():
    # [T]: 0.2 for viscose rayon on itself, a thirteenth of the shell in contact; kinetic seven times static.
    assert pytest.approx(0.2 / 13, abs=5e-4) == STATIC
    assert bench.THREADS["kinetic_coefficient"] / STATIC == pytest.approx(7)


@pytest.mark.parametrize("function", ["lift_off", "contraction"])
def test_slopes_equal_finite_differences(function):
    def value(x):
        muscle = type(MUSCLE)(*x[:4])
        if function == "lift_off":
            return lift_off_pressure(muscle, x[4], x[5])
        return isotonic_contraction(muscle, x[4], 2e5 + 1e6 * x[5])

    point = jnp.asarray([*map(float, jax.tree.leaves(MUSCLE)), 196.0, STATIC])
    for i, slope in enumerate(jax.grad(value)(point)):
        step = 1e-6 * float(point[i])
        e = np.eye(6)[i] * step
        difference = (value(point + e) - value(point - e)) / (2 * step)
        # Zero where a quantity has no say: the end factor at lift-off.
        assert float(slope) == pytest.approx(float(difference), rel=1e-6, abs=1e-6 * abs(float(value(point))))
