"""`jm.simulate` in fixed and in controlled steps: agreement, error estimates, hysteresis, contact, errors."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.errors import InputError
from jaxmuscle.simulation import run, start_at_rest
from jaxmuscle.simulation.solvers import CONTROLLED, METHODS

CLOCK = np.arange(300) * 0.002
COMMAND = np.select([CLOCK < 0.15, CLOCK < 0.5], [5.0, -5.0], 4.0)
"""Lift the mass, let it fall, catch it [V]."""
DECLARED = {
    "thread_friction": bench.THREADS,
    "length_hysteresis": bench.LOOP,
    "creep": {"stiffness": 50.0},
}


@pytest.fixture(scope="module")
def machine():
    return bench.model("isotonic", **DECLARED)


@pytest.fixture(scope="module")
def exact(machine):
    """Steps of 8 us, by a method of another kind than those that are tested against it."""
    return jm.simulate(machine, COMMAND, CLOCK, method="heun", substeps=256).readings


def far(readings, exact):
    """Largest deviation of all readings relative to their range."""
    return max(bench.deviation(readings[name], np.asarray(exact[name])) for name in exact)


def test_what_is_asked_for_is_a_lift_and_a_fall(exact):
    assert np.ptp(exact["position"]) > 0.02
    assert np.diff(np.asarray(exact["position"])).min() < -1e-4


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_every_method_comes_to_the_same(machine, exact, method):
    coarse, fine = (
        far(jm.simulate(machine, COMMAND, CLOCK, method=method, substeps=n).readings, exact) for n in (4, 16)
    )
    assert fine < 1e-4
    assert fine < 0.5 * coarse or coarse < 1e-5


def test_own_method_is_the_stabilised_one(machine):
    own, named = (
        jm.simulate(machine, COMMAND, CLOCK, method=m, substeps=2).readings for m in (None, "chebyshev")
    )
    for name in own:
        np.testing.assert_array_equal(own[name], named[name])


@pytest.mark.parametrize("method", CONTROLLED)
def test_controlled_steps_agree_with_short_ones(machine, exact, method):
    loose, tight = (
        far(jm.simulate(machine, COMMAND, CLOCK, method=method, tolerance=tolerance).readings, exact)
        for tolerance in (1e-3, 1e-7)
    )
    assert tight < 1e-5
    assert tight < loose


@pytest.mark.slow
@pytest.mark.parametrize(
    "asked",
    [{"substeps": 1}, {"substeps": 4}, {"method": "dormand-prince", "substeps": 2}, {"tolerance": 1e-4}],
    ids=str,
)
def test_estimate_bounds_the_true_error_and_is_not_vain(machine, exact, asked):
    found = jm.simulate(machine, COMMAND, CLOCK, error=True, **asked)
    assert found.error is not None
    for name, reading in found.readings.items():
        true = np.maximum.accumulate(np.abs(np.asarray(reading) - np.asarray(exact[name])))
        bound = np.asarray(found.error[name])
        floor = 1e-6 * np.ptp(exact[name])
        assert (true <= bound + floor).all()
        assert bound[-1] < 20 * true[-1] + floor


def test_error_is_not_estimated_unasked(machine):
    assert jm.simulate(machine, COMMAND, CLOCK).error is None


@pytest.mark.slow
@pytest.mark.parametrize("asked", [{"substeps": 3}, {"substeps": 1, "tolerance": 1e-5}], ids=str)
def test_play_operators_are_exact(machine, asked):
    """At every sample of the way up they are what the whole way makes of them, not a sum over steps."""
    track = bench.isotonic_track(COMMAND)
    method = CONTROLLED[0]
    tolerance = None if "tolerance" not in asked else jnp.asarray(asked["tolerance"])
    kept = eqx.filter_jit(run)(
        machine, track, start_at_rest(machine, track), jnp.asarray(0), samples=len(CLOCK), imposed=(),
        substeps=asked["substeps"], keep=("position",), method=method, tolerance=tolerance,
    ).states  # fmt: skip
    strain = np.asarray(machine.muscle.strain(kept.state["position"]))
    rising = int(np.flatnonzero(np.diff(strain) < 0)[0])
    assert strain[rising] > 0.03
    expected = np.maximum(strain[:, None] - np.linspace(0.01, 0.08, 8), 0.0)
    np.testing.assert_allclose(kept.memory["length_hysteresis"][:rising], expected[:rising], atol=1e-15)


@pytest.mark.slow
def test_slope_goes_through_controlled_steps(machine):
    def final(area):
        readings = jm.simulate(
            jm.replace(machine, {"valve.area": area}), COMMAND, CLOCK, tolerance=1e-6
        ).readings
        return jnp.stack([readings["pressure"][90], readings["position"][90]])

    area = machine.valve.area
    _, slope = jax.jvp(final, (area,), (jnp.ones_like(area),))
    width = 1e-3 * float(area)
    difference = (final(area + width) - final(area - width)) / (2 * width)
    np.testing.assert_allclose(slope, difference, rtol=1e-3)


@pytest.mark.slow
def test_reverse_mode_gives_what_forward_mode_gives():
    machine = bench.model("isotonic", length_hysteresis=bench.LOOP)

    def final(area):
        readings = jm.simulate(jm.replace(machine, {"valve.area": area}), COMMAND, CLOCK).readings
        return readings["position"][290]

    area = machine.valve.area
    assert float(jax.grad(final)(area)) == pytest.approx(float(jax.jacfwd(final)(area)), rel=1e-9)


@pytest.mark.slow
def test_controlled_steps_of_a_batch_are_those_of_each_alone(machine):
    def top(mass):
        machine_of = jm.replace(machine, {"mass": mass})
        return jm.simulate(machine_of, COMMAND, CLOCK, tolerance=1e-5).readings["position"]

    masses = jnp.array([5.0, 8.0])
    together = jax.vmap(top)(masses)
    for lane, mass in enumerate(masses):
        np.testing.assert_allclose(together[lane], top(mass), rtol=1e-9, atol=1e-12)


REFUSED = {
    "unknown method": ({"method": "rk45"}, "unknown 'rk45'.*heun"),
    "no estimate": ({"method": "heun", "tolerance": 1e-4}, "'heun' does not estimate.*bogacki"),
    "no substeps": ({"substeps": 0}, "from 1 to 100000; got 0"),
    "half a substep": ({"substeps": 1.5}, "whole number.*got 1.5"),
    "tolerance": ({"tolerance": 0.0}, "1e-13 to 0.1; got 0.0"),
    "not a number": ({"tolerance": float("nan")}, "1e-13 to 0.1; got nan"),
}


@pytest.mark.parametrize("why", REFUSED)
def test_refused(machine, why):
    asked, message = REFUSED[why]
    with pytest.raises(InputError, match=message):
        jm.simulate(machine, COMMAND, CLOCK, **asked)
