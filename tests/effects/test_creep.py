"""Creep that goes on: against a closed form, the work it takes, and machines that are no braided muscle."""

from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.bench import built
from oracles.driven import driven, lagged

import jaxmuscle as jm
from jaxmuscle.actuators import AbstractImposed, Reading, StateVariable
from jaxmuscle.effects import CATALOGUE, FURTHER, BladderHoopStiffness, Creep, ForceDrift, ViscoelasticCreep
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import MUSCLE_FORCE, Signals

STEP = bench.STEPS["driven"]
CREEP = {"stiffness": 300.0, "fast_time": 0.1, "slow_time": 0.7}
LENGTH = bench.CARDS["driven"]["initial_length"]


def force_of(position, **effects):
    """Force of the test machine's muscle at constant pressure, pulled to the positions."""
    still = np.full(len(position), bench.AMBIENT + 2e5), position, np.gradient(position, STEP)
    return np.asarray(
        bench.simulated(bench.model("driven", **effects), bench.driven_track(*still), 4).readings["force"]
    )


def test_equals_the_oracle_of_what_is_delayed():
    motion = bench.driven_motion()
    strain = motion[1] / LENGTH
    late = [lagged(strain, STEP, CREEP[name], 50) for name in ("fast_time", "slow_time")]
    force = driven(bench.CARDS["driven"], {}, *motion) - CREEP["stiffness"] * (strain - 0.5 * sum(late))
    model = bench.model("driven", viscoelastic_creep=CREEP)
    readings = bench.simulated(model, bench.driven_track(*motion), 4).readings
    assert bench.deviation(readings["force"], force) < 1e-6


def test_the_force_rises_after_a_contraction_by_two_exponentials():
    position = np.where(np.arange(200) < 5, 0.0, 0.02)
    lost = force_of(position) - force_of(position, viscoelastic_creep=CREEP)
    # The machine contracts along a straight line from one sample to the next.
    later, times = STEP * np.arange(195), np.array([[CREEP["fast_time"]], [CREEP["slow_time"]]])
    begun = times / STEP * -np.expm1(-STEP / times)
    fading = (begun * np.exp(-later / times)).mean(axis=0)
    np.testing.assert_allclose(lost[:5], 0.0, atol=1e-9)
    np.testing.assert_allclose(lost[5:], CREEP["stiffness"] * 0.02 / LENGTH * fading, rtol=1e-4)


@pytest.mark.parametrize("hertz", [0.1, 0.5, 2.0])
def test_takes_energy_in_a_cycle_and_a_resistance_that_builds_up_gives_it(hertz):
    period = round(1 / hertz / STEP)
    position = 0.01 * (1 - np.cos(2 * np.pi * np.arange(12 * period + 1) / period))
    bare, last = force_of(position), slice(-period - 1, None)

    def work(**effects):
        pulled = (force_of(position, **effects) - bare)[last]
        return float(np.sum(0.5 * (pulled[1:] + pulled[:-1]) * np.diff(position[last])))

    assert work(viscoelastic_creep=CREEP) < 0 < work(creep=CREEP)
    assert work(viscoelastic_creep=CREEP) == pytest.approx(-work(creep=CREEP), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Creep, ViscoelasticCreep])
def test_slopes_at_rest_and_in_motion(kind):
    def force(values, strain):
        effect = built(kind, **dict(zip(CREEP, values, strict=True)))
        signals = Signals(contraction_ratio=strain)
        state = effect.initial(Signals(contraction_ratio=jnp.asarray(0.1)))
        return effect.value(state + STEP * effect.rate(state, signals), signals)

    values, h = jnp.array([*CREEP.values()]), 1e-6
    for strain in (jnp.asarray(0.1), jnp.asarray(0.12)):
        slopes = jax.jacfwd(force, argnums=(0, 1))(values, strain)
        by_value = [(force(values + s, strain) - force(values - s, strain)) / (2 * h) for s in h * np.eye(3)]
        np.testing.assert_allclose(slopes[0], by_value, rtol=1e-6, atol=1e-7)
        by_strain = (force(values, strain + h) - force(values, strain - h)) / (2 * h)
        np.testing.assert_allclose(slopes[1], by_strain, rtol=1e-6)


class Band(AbstractImposed):
    """A rubber band on a test machine, F = k x: it pulls, and has neither braid nor bladder."""

    rig: ClassVar = "band"
    units: ClassVar = {"load": "N", "motion": "m"}
    quantities: ClassVar = {"rate": "rate"}
    variables: ClassVar = (
        StateVariable("position", "m", ("position",), rate="velocity", imposed=True),
        Reading("force", "N", ("force",), ("position", "velocity"), "muscle_force"),
    )
    available: ClassVar = frozenset({"time", "position", "velocity", "contraction_ratio", "muscle_force"})

    rate: Scalar = parameter("N/m", "force over the length by which it is stretched", positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def signals(self, state, held):
        states = {**state.get("effects", {}), **held.memory}
        signals = Signals(
            time=held.time, position=state["position"], contraction_ratio=state["position"] / -0.1
        )
        return self._with(signals, MUSCLE_FORCE, self.rate * state["position"], states)

    def readings(self, signals):
        return {"force": signals.muscle_force}


def test_what_pulls_without_a_braid_has_creep_and_no_effect_that_asks_for_the_braid():
    offered = {effect for effect in (*CATALOGUE, *FURTHER) if Band.offers(effect)}
    assert {Creep, ViscoelasticCreep, ForceDrift} <= offered and BladderHoopStiffness not in offered
    assert all(type(bench.model("driven")).offers(each) for each in (Creep, ViscoelasticCreep, ForceDrift))
    names = {effect.name: effect() for effect in offered}
    clock = 0.01 * np.arange(60)
    columns = {"position": 0.01 + 0.01 * np.sin(9 * clock), "force": np.zeros(60)}
    band = Band(rate=jnp.asarray(800.0))
    recording = jm.recording(band, columns, 0.01, noise={"force": 0.1}, name="band")
    expected = np.asarray(jm.simulate(band, recording).readings["force"])
    carrying = band.with_effects(**names)
    np.testing.assert_array_equal(jm.simulate(carrying, recording).readings["force"], expected)
    stiffer = band.with_effects(viscoelastic_creep=built(ViscoelasticCreep, **CREEP))
    added = np.asarray(jm.simulate(stiffer, recording).readings["force"]) - expected
    assert np.corrcoef(added, columns["position"])[0, 1] > 0.9 and np.abs(added).max() > 1.0
