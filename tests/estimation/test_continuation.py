"""Dry friction smoothed widely at first: the width does what it says, and leaves the answer as it is."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from estimation.own_rig import Drive

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.effects.slip import STICKING_TIME, slip_of_mass, slip_of_velocity
from jaxmuscle.estimation.dataset import station, widened
from jaxmuscle.estimation.residuals import residual_vector

STEP, NOISE = 4e-3, 2e-5
TRUE = {"mass": 30.0, "effects.load_friction.force": 20.0, "effects.load_damping.coefficient": 200.0}
FREE = ["mass", "load_friction.force", "load_damping.coefficient"]


class Fine(Drive):
    """In steps short against the time in which a mass comes to rest."""

    largest_step = 1e-3


def drive(mass=30.0, friction=20.0, damping=200.0):
    """A drive with Coulomb and viscous friction."""
    bare = Fine(mass=mass, gain=35.0)  # pyright: ignore[reportArgumentType]
    dry = jm.effects.LoadFriction(force=friction)  # pyright: ignore[reportArgumentType]
    oil = jm.effects.LoadDamping(coefficient=damping)  # pyright: ignore[reportArgumentType]
    return bare.with_effects(load_friction=dry, load_damping=oil)


@pytest.fixture(scope="module")
def recording():
    """In plain NumPy with sharp Coulomb friction."""
    time = STEP * np.arange(700)
    x, v, found = 0.0, 0.0, []
    command = 1.2 * np.sin(2 * np.pi * 0.5 * time) + 0.9 * np.sin(2 * np.pi * 1.3 * time + 1)
    for u in command:
        found.append(x)
        for _ in range(20):
            force = 35.0 * u - 200.0 * v
            if v == 0 and abs(force) <= 20.0:
                continue
            sense = np.sign(v) if v else np.sign(force)
            new = v + STEP / 20 * (force - 20.0 * sense) / 30.0
            v = 0.0 if v * new < 0 else new
            x += STEP / 20 * v
    noise = NOISE * np.random.default_rng(0).normal(size=len(time))
    columns = {"command": command, "position": np.array(found) + noise}
    return jm.recording(drive(), columns, STEP, noise={"position": NOISE}, horizon=0.5, name="drive")


def test_the_width_is_a_factor_of_the_sticking_time():
    momentum, limit = jnp.asarray(3e-4), jnp.asarray(2.0)
    wide = slip_of_mass(jnp.zeros(()), momentum, limit, 5.0)
    assert wide == pytest.approx(3e-4 / (5 * STICKING_TIME) / 2, rel=1e-12)
    assert slip_of_mass(jnp.zeros(()), momentum, limit) == pytest.approx(5 * float(wide), rel=1e-12)
    assert slip_of_velocity(jnp.asarray(5e-5), widening=5.0) == jnp.tanh(0.1)
    assert slip_of_velocity(jnp.asarray(5e-5)) == jnp.tanh(0.5)


@pytest.mark.slow
def test_at_factor_one_nothing_changes_and_at_a_large_one_friction_creeps(recording):
    """The gradient by the width is finite too: it is data, one compilation serves all of them."""
    place = station(drive(), recording, "drive", None, {})
    theta, paths = jnp.asarray([30.0, 20.0]), ("mass", "effects.load_friction.force")

    @jax.jit
    def residuals(factor):
        (wide,) = widened([place], factor)
        return residual_vector(theta, place.actuator, wide.problem, paths)

    plain = np.asarray(residual_vector(theta, place.actuator, place.problem, paths))
    np.testing.assert_allclose(residuals(1.0), plain, atol=1e-9 * np.abs(plain).max())
    assert np.linalg.norm(np.asarray(residuals(200.0)) - plain) > 10 * np.linalg.norm(plain)
    h = 1e-4
    slope = jax.jvp(residuals, (30.0,), (1.0,))[1]
    difference = (residuals(30.0 + h) - residuals(30.0 - h)) / (2 * h)
    np.testing.assert_allclose(slope, difference, atol=1e-4 * float(np.abs(difference).max()))


@pytest.mark.slow
def test_from_wide_to_narrow_to_the_same_answer(recording):
    stages: list[str] = []
    machine = drive(15.0, 30.0, 100.0)
    fit = jm.fit(machine, recording, FREE, continuation=(30, 6), progress=stages.append)
    names = list(dict.fromkeys(line.split(",")[0] for line in stages if "cost" in line))
    assert names[:3] == ["friction 30 times as wide", "friction 6 times as wide", "windows in 4 parts"]
    assert fit.converged and fit.settings["continuation"] == [30.0, 6.0]
    plain = jm.fit(machine, recording, FREE)
    for name, true in TRUE.items():
        assert abs(fit.values[name] - true) < 4 * fit.std[name], name
        assert abs(fit.values[name] - plain.values[name]) < 0.1 * fit.std[name], name
    assert dataclasses.asdict(fit.parameters["mass"])["start"] == 15.0


@pytest.mark.parametrize("factors", [(6, 30), (3, 0.5), (5, 5), (1.0,)])
def test_factors_that_do_not_fall(recording, factors):
    with pytest.raises(InputError, match=r"continuation: expected factors that fall .* such as \(30, 6\)"):
        jm.fit(drive(), recording, FREE, continuation=factors)
