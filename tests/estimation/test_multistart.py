"""From bad starts to the minimum: parts of windows first, and a joint that sticks and slips."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from estimation.made import pulled
from estimation.own_rig import STEP, drive, measured
from oracles import bench
from oracles.joint import joint

import jaxmuscle as jm
from jaxmuscle.estimation.dataset import station
from jaxmuscle.estimation.multistart import Search, _on_whole_windows, stages
from jaxmuscle.optimization.descents import Lane, Limits, Local


def test_windows_are_cut_as_long_as_parts_have_samples():
    machine = drive()

    def levels(horizon, continuation=()):
        recording = jm.recording(machine, measured(), STEP, horizon=horizon)
        found = list(stages([station(machine, recording, "own", None, {})], continuation))
        periods = [int(stations[0].problem.period) for _, stations in found]
        whole = round((horizon or 4.0) / STEP)
        assert periods == sorted(periods) and periods[-1] == -(-whole // 4)
        return [name for name, _ in found]

    assert levels(None) == ["windows in 40 parts", "windows in 16 parts", "windows in 4 parts"]
    assert levels(1.0) == ["windows in 16 parts", "windows in 4 parts"]
    assert levels(0.1) == ["windows in 4 parts"]
    assert levels(None, (30.0, 6.0)) == [
        "friction 30 times as wide", "friction 6 times as wide", "windows in 4 parts"
    ]  # fmt: skip


def test_out_of_time_on_the_way_through_the_parts():
    recording = dataclasses.replace(pulled(off=1.4), name="late")
    found = jm.fit(jm.actuator(recording.card), recording, budget=1e-3)
    assert found.code == "budget" and np.isfinite(found.cost)


@pytest.mark.slow
def test_every_start_reaches_the_minimum_of_a_joint_that_sticks():
    """Half or one and a half times every parameter; in quarters of windows alone a third gets lost."""
    effects = {"load_friction": {"force": 0.4}, "load_damping": {"coefficient": 0.05}}
    command, step = bench.joint_command(), bench.STEPS["joint"]
    first, second, angle, _ = joint(bench.CARDS["joint"], effects, command, step, command[0], 0.0, 8)
    rng, machine = np.random.default_rng(0), bench.model("joint", **effects)
    noisy = {"pressure_1": first, "pressure_2": second, "angle": angle}
    noise = {"pressure_1": 400.0, "pressure_2": 400.0, "angle": 3e-4}
    columns = {name: values + noise[name] * rng.normal(size=len(values)) for name, values in noisy.items()}
    columns |= {"command_1": command[:, 0], "command_2": command[:, 1]}
    recording = jm.recording(machine, columns, step, noise=noise, horizon=0.4)
    true = {"regulator_frequency": 12.0, "end_factor": 1.303, "inertia": 0.04}
    true |= {"effects.load_friction.force": 0.4}
    signs = np.random.default_rng(1).choice([-0.5, 0.5], size=(8, len(true)))
    starts = [{n: v * (1 + s) for (n, v), s in zip(true.items(), row, strict=True)} for row in signs.tolist()]
    result = jm.fit(machine, recording, list(true), starts=starts)
    assert sum(start.reached for start in result.starts) >= 7
    for name, value in true.items():
        assert abs(result.parameters[name].value - value) < 4 * result.std[name], name


class TwoValleys:
    """Half the squares of x² - 1 and 0.3 (x - 1): a minimum near -0.95, and a lower one at 1."""

    def at(self, points):
        return [self._local(float(x)) for x in points[:, 0]]

    def _local(self, x):
        residual, slope = np.array([x**2 - 1, 0.3 * (x - 1)]), np.array([2 * x, 0.3])
        return Local(
            0.5 * float(residual @ residual), np.array([slope @ residual]), np.array([[slope @ slope]]), 0
        )


@pytest.mark.parametrize(("begin", "led", "end"), [(0.9, -0.9, 1.0), (-0.9, 0.9, 1.0), (0.0, -0.9, -0.952)])
def test_a_start_that_is_better_than_where_parts_led_is_kept(begin, led, end):
    """A machine that was fitted before does not lose its valley; a start that is worse decides nothing."""
    there = np.array([led])
    lanes, limits = (
        [Lane(there, np.zeros(1, bool), there)],
        Limits(-np.full(1, np.inf), np.full(1, np.inf), 50, 1),
    )
    objective: Any = TwoValleys()
    task = Search(objective, np.array([[begin]]), 50, np.inf, None, lambda stage, course: None)
    _, (found,) = _on_whole_windows(task, objective, lanes, limits, lambda course: None)
    assert found.u[0] == pytest.approx(end, abs=0.01)
