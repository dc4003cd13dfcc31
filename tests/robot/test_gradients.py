"""Derivatives of whole runs of the robot, forward and reverse, under vmap, against finite differences."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.robot_bench import PANE, held, machine

from jaxmuscle.effects import LoadDamping
from jaxmuscle.parameters import parameters, replace
from jaxmuscle.robot import tip

SAMPLES, SUBSTEPS = 60, 1
ROBOT = machine({**PANE, "arm.payload": 0.5, "arm.gravity": 0.3, "initial_contraction": 0.15}).with_effects(
    load_damping=bench.built(LoadDamping, coefficient=0.1)
)
PATHS = list(parameters(ROBOT))
VALUES = np.array([float(p.value) for p in parameters(ROBOT).values()])
SIZES = np.where(VALUES == 0, 0.1, np.abs(VALUES))
SCENES = {
    "at rest": held([2.5e5] * 4, [2.5e5] * 4, [0.01, 0.05], SAMPLES),
    "breaking away": held([2.5e5] * 4, [4.5e5, 0.5e5, 1.5e5, 3.5e5], [0.1, 0.3], SAMPLES),
    "one joint stuck": held([2.5e5] * 4, [4.1e5, 0.9e5, 2.5e5, 2.5e5], [0.0, 0.0], SAMPLES),
    "reversing": held([1.5e5, 3.5e5] * 2, [1.5e5, 3.5e5] * 2, [0.2, 0.3], SAMPLES, [2.0, 4.0]),
    "into the pane": held([2.5e5] * 4, [3e5, 2e5, 3e5, 2e5], [0.7, 0.5], SAMPLES, [1.0, -2.0]),
    "slack": held([3e5, 2e5] * 2, [3e5, 2e5] * 2, [2.9, 2.9], SAMPLES, [0.5, 0.5]),
}

WEIGHTS = np.random.default_rng(5).normal(size=(SAMPLES, 2))


@cache
def stacked():
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *SCENES.values())


def angles(values, track):
    changed = replace(ROBOT, dict(zip(PATHS, values, strict=True)))
    return bench.simulate(changed, track, SUBSTEPS).readings["angle"]


def over_scenes(function):
    return jax.jit(jax.vmap(function, in_axes=(None, 0)))


RUN, FORWARD = over_scenes(angles), over_scenes(jax.jacfwd(angles))


@cache
def forward():
    return np.asarray(FORWARD(VALUES, stacked())) * SIZES


@pytest.mark.slow
def test_forward_equals_finite_differences():
    derivative = forward()
    assert np.isfinite(derivative).all()
    steps = np.diag(1e-6 * SIZES)
    difference = np.stack(
        [(RUN(VALUES + s, stacked()) - RUN(VALUES - s, stacked())) / 2e-6 for s in steps], axis=-1
    )
    error, scale = np.abs(derivative - difference).max((1, 2)), np.abs(difference).max((1, 2))
    wrong = [
        f"{list(SCENES)[i]}: {PATHS[j]} {error[i, j]:.1e} of {scale[i, j]:.1e}"
        for i, j in np.argwhere(error > 1e-5 * scale + 1e-8)
    ]
    assert not wrong, wrong


@cache
def reverse():
    """Gradients of a weighted sum of all angles over the parameters and over the commands, and that sum."""

    def total(values, command, track):
        return (WEIGHTS * angles(values, bench.Track(track.step, command, track.measured))).sum()

    both = jax.jit(jax.vmap(jax.grad(total, argnums=(0, 1)), in_axes=(None, 0, 0)))
    return both(VALUES, stacked().command, stacked())


@pytest.mark.slow
def test_reverse_equals_forward():
    gradient = np.asarray(reverse()[0]) * SIZES
    np.testing.assert_allclose(gradient, np.einsum("stqp,tq->sp", forward(), WEIGHTS), rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_gradient_over_the_commands_equals_finite_differences():
    tracks, slope = stacked(), np.asarray(reverse()[1])
    assert np.isfinite(slope).all()
    way = np.random.default_rng(6).normal(size=slope.shape)

    def total(sign):
        moved = bench.Track(tracks.step, tracks.command + sign * way, tracks.measured)
        return np.einsum("stq,tq->s", RUN(VALUES, moved), WEIGHTS)

    difference = (total(1.0) - total(-1.0)) / 2
    np.testing.assert_allclose((slope * way).sum((1, 2)), difference, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_scenes_are_what_they_say():
    moved = dict(zip(SCENES, np.asarray(RUN(VALUES, stacked())), strict=True))
    assert np.ptp(moved["at rest"], axis=0).max() < 1e-9
    assert np.ptp(moved["breaking away"], axis=0).min() > 1e-2
    sliding, stuck = np.ptp(moved["one joint stuck"], axis=0)
    assert stuck < 1e-9 < 5e-3 < sliding
    ways = np.diff(moved["reversing"], axis=0)
    assert (ways.max(axis=0) > 0).all() and (ways.min(axis=0) < 0).any()
    assert ROBOT.pane.penetration(tip(ROBOT.arm, jnp.asarray(moved["into the pane"]))).max() > 1e-3
    assert moved["slack"].min() > 2.5
