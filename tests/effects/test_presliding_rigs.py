"""Presliding on every machine that has dry friction: stable from the stiffest bristles to the softest."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from oracles.robot_bench import AMBIENT
from oracles.robot_bench import machine as robot

from jaxmuscle.effects import Presliding
from jaxmuscle.parameters import replace

DISTANCES = jnp.array([0.0, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2])


def lift():
    return (
        bench.model("isotonic", load_friction={"force": 40.0}),
        bench.isotonic_track(bench.isotonic_command()),
        "position",
        1,
    )


def piston():
    command = bench.piston_command()[:200]
    return bench.model("jet-pipe-piston"), bench.track("jet-pipe-piston", command), "force", 8


def arm():
    t = np.arange(300) * bench.STEPS["scara"]
    turn = 1e5 * np.sin(2 * np.pi * 2 * t)[:, None] * [1.0, -1.0, -0.7, 0.7]
    command = AMBIENT + 2.5e5 + turn
    still = {"pressure": command[0], "angle": np.zeros(2), "angular_velocity": np.zeros(2)}
    return robot(), bench.track("scara", command, **still), "angle", 1


@pytest.mark.slow
@pytest.mark.parametrize("case", [lift, piston, arm], ids=lambda case: case.__name__)
def test_is_stable_and_approaches_the_law_without_bristles(case):
    bare, track, reading, substeps = case()
    machine = bare.with_effects(presliding=Presliding())

    def shown(distance):
        changed = replace(machine, {"effects.presliding.distance": distance})
        return bench.simulate(changed, track, substeps).readings[reading]

    runs = np.asarray(jax.jit(jax.vmap(shown))(DISTANCES))
    rigid = np.asarray(bench.simulated(bare, track, substeps).readings[reading])
    assert np.isfinite(runs).all()
    size = np.ptp(rigid, axis=0)
    gaps = (np.abs(runs - rigid) / size).reshape(len(DISTANCES), -1).max(1)
    assert (size > 0).all()
    assert gaps[0] < 1e-9
    assert gaps[1] < 1e-3
    assert gaps.max() < 1.0
    assert gaps[-1] > 1e-3
