"""The controllers of [T] on one joint of its robot: tuned by gradient descent through the loop, judged."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from published_rows import OWN, WORDS, Row, aside, assuming, at_most, half_digit, row

import jaxmuscle as jm
from jaxmuscle.components import antagonist
from jaxmuscle.control import FuzzyPID, JointModel, Reference, SlidingMode, closed_loop, feedback_on
from jaxmuscle.parameters import get, replace
from jaxmuscle.robot import identify, joint_motion, robot_joint
from jaxmuscle.robot.tondu2000 import MEAN_PRESSURE, robot_arm

AMBIENT, STEP = 101325.0, 2e-3
INERTIAS = tuple(float(j) for j in np.diag(robot_arm().mass_matrix(jnp.zeros(2))))
"""Largest inertias of joints 1 and 2 without a load [kg m^2]."""
QUIET = 0.02
"""Change of a command from sample to sample that costs as much as an error of one degree [bar]."""
TRADED = (
    "the gains are those at which a smaller error would shake the valves more, tuned at 0.5 rad/s on each "
    "joint alone; [T] gives no gains"
)
MOST_STEPS = 150
"""Of a descent; with 40 it stops where rounding errors lead it."""
SLIDING = {
    "slope": (8.0, 5.0, 10.0), "curvature": (0.02, 0.01, 0.05), "per_error": (1e5, 1e3, 1e7),
    "per_rate": (1e4, 1e2, 1e6), "least": (5e3, 1e2, 1e6), "integral_gain": (2e5, 1e3, 1e8),
}  # fmt: skip
"""The six numbers that [T] tunes: where the descent begins, and between what; C and C' as [T] has them."""
FUZZY = {
    "error_range": (0.3, 0.02, 3.0), "rate_range": (3.0, 0.2, 30.0), "proportional": (1e5, 1e4, 1e6),
    "integral": (1e5, 1e3, 1e8),
}  # fmt: skip
PUBLISHED = {(1, 0.5): "0.5", (2, 0.5): "1.5", (1, 1.0): "1", (2, 1.0): "3", (1, 2.0): "1.5"}
"""Joint, cruising speed [rad/s] → dynamic accuracy [deg], [T] Figure 19 and the text beside it; that of joint
2 at 2 rad/s is not legible.
"""
GAINS = "the six gains of each joint, tuned here: [T] prints none"
NO_NOISE = "measured there; no sensor noise here"


class Tuned(NamedTuple):
    """A controller, and the cost before and after its descent: a squared error in degrees."""

    controller: Any
    before: float
    after: float
    steps: int


@cache
def identified(inertia: float) -> JointModel:
    """[T] 28 from a step of 1 bar in open loop."""
    times = np.arange(1500) * STEP
    commands = AMBIENT + MEAN_PRESSURE + 1e5 * np.tile([1.0, -1.0], (1500, 1))
    rest = {"pressure": np.full(2, AMBIENT + MEAN_PRESSURE)}
    angle = jm.simulate(robot_joint(inertia), commands, times, start=rest).readings["angle"]
    kind: Any = JointModel
    return kind(*identify(np.full(1500, 1e5), angle, STEP).system.coefficients)


def begun(inertia: float, fuzzy: bool) -> tuple[Any, dict[str, tuple[float, float, float]]]:
    """A controller before its tuning, and what is tuned of it."""
    numbers: Any = FUZZY if fuzzy else SLIDING
    kind: Any = FuzzyPID if fuzzy else SlidingMode
    values = {name: first for name, (first, _, _) in numbers.items()}
    return kind(**values) if fuzzy else kind(identified(inertia), **values, boundary=0.3), numbers


def posture(angle: float) -> dict[str, Any]:
    """Where the joint rests at an angle."""
    joint = robot_joint(INERTIAS[0])
    k = antagonist.coefficients(joint.muscle, joint.sprocket_radius, joint.initial_contraction)
    half = antagonist.pressure_difference(k, jnp.asarray(MEAN_PRESSURE), jnp.asarray(angle), jnp.asarray(0.0))
    return {"angle": angle, "pressure": AMBIENT + MEAN_PRESSURE + half * np.array([1.0, -1.0])}


def motion(speed: float, rounds: int) -> tuple[NDArray[np.float64], Reference]:
    """[T]: to and fro between -1 and 1 rad by a pseudo-trapezoid of a speed and as large an acceleration."""
    way = joint_motion([-1.0, 0.0], [1.0, 0.0], speed, speed)
    times = np.arange(0, 2 * rounds * float(way.duration), STEP)
    return times, Reference(*(values[:, 0] for values in way.to_and_fro(times, rounds)))


def followed(inertia: float, controller: Any, times: Any, wanted: Reference) -> tuple[Any, Any]:
    """Errors of the angle [rad] and the commands [Pa]."""
    machine = robot_joint(inertia)
    reference = wanted.angle if isinstance(controller, FuzzyPID) else wanted
    found = closed_loop(machine, feedback_on(machine, controller), reference, times, start=posture(-1.0))
    return wanted.angle - found.readings["angle"], found.commands


@cache
def tuned(joint: int, fuzzy: bool = False) -> Tuned:
    """Gradient descent in the logarithms of the gains, through one to-and-fro at 0.5 rad/s.

    Each step goes along the gradient of the cost's logarithm, half as far until the cost falls.
    """
    inertia = INERTIAS[joint - 1]
    first, numbers = begun(inertia, fuzzy)
    times, wanted = motion(0.5, 1)
    low, high = (np.log([entry[i] for entry in numbers.values()]) for i in (1, 2))

    def of(z: Any) -> Any:
        return replace(first, dict(zip(numbers, jnp.exp(z), strict=True)))

    def cost(z: Any) -> Any:
        error, commands = followed(inertia, of(z), times, wanted)
        rough = jnp.diff(commands[:, 0]) / (QUIET * 1e5)
        return jnp.log(jnp.mean(jnp.rad2deg(error) ** 2) + jnp.mean(rough**2))

    value, slope = jax.jit(cost), jax.jit(jax.jacfwd(cost))
    z = jnp.log(jnp.array([float(get(first, name)) for name in numbers]))
    before = now = float(value(z))
    down, size, steps = slope(z), 0.5, 0
    while size > 1e-4 and steps < MOST_STEPS:
        there = jnp.clip(z - size * down / jnp.linalg.norm(down), low, high)
        cost_there, steps = float(value(there)), steps + 1
        if cost_there < now:
            z, now, down, size = there, cost_there, slope(there), 1.3 * size
        else:
            size *= 0.5
    return Tuned(of(z), float(np.exp(before)), float(np.exp(now)), steps)


def judged(joint: int, speed: float, fuzzy: bool = False) -> NDArray[np.float64]:
    """Errors [deg] over three to-and-fros."""
    error, _ = followed(INERTIAS[joint - 1], tuned(joint, fuzzy).controller, *motion(speed, 3))
    return np.rad2deg(np.asarray(error))


def joint_rows() -> Iterator[Row]:
    for joint in (1, 2):
        for fuzzy, name in ((False, "variable structure"), (True, "fuzzy PID")):
            made = tuned(joint, fuzzy)
            share = made.after / made.before
            values = {n: float(get(made.controller, n)) for n in (FUZZY if fuzzy else SLIDING)}
            print(f"    joint {joint}, {name}: {made.before:.3g} to {made.after:.3g} deg² in {made.steps} "
                  "steps; " + ", ".join(f"{n} {v:.3g}" for n, v in values.items()))  # fmt: skip
            less = row("[T] control", f"joint {joint}, {name}: cost tuned by gradient over that before",
                       "tuned by hand", share, share < 0.25, "", "< 0.25",
                       "gradient descent through the loop")  # fmt: skip
            yield aside(less, OWN)
    source = "[T] Figure 19"
    for (joint, speed), goal in PUBLISHED.items():
        worst = float(np.abs(judged(joint, speed)).max())
        figure = f"joint {joint} at {speed:g} rad/s: largest error"
        entry = at_most(source, figure, goal, worst, "deg", NO_NOISE, TRADED, half_digit("0.5"))
        yield assuming(entry, GAINS)
    still = max(abs(float(judged(joint, 0.5)[-1])) for joint in (1, 2))
    yield assuming(at_most(source, "static error of both joints", "0.2", still, "deg", NO_NOISE), GAINS)
    worst = [float(np.abs(judged(1, 0.5, fuzzy)).max()) for fuzzy in (False, True)]
    robust = row("[T] control", "fuzzy PID on joint 1 at 0.5 rad/s: largest error over that of the variable "
                 "structure", "almost as robust", worst[1] / worst[0], worst[1] < 2 * worst[0], "", "< 2",
                 "in words; its gains are not given",
                 "it knows no model of the joint: all that moves it has to come from an error")  # fmt: skip
    yield aside(robust, WORDS)
    for name, answer in step_answers().items():
        times, error = answer
        angle = 0.5 - error
        rise, over = STEP * float(np.argmax(angle > 0.45) - np.argmax(angle > 0.05)), angle.max() / 0.5 - 1
        print(f"    joint 1, step of 0.5 rad, {name}: 10 to 90 % in {rise:.2f} s, overshoot "
              f"{100 * over:.1f} %, error after {times[-1]:.1f} s {error[-1]:.1e} rad")  # fmt: skip


def step_answers() -> dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Times and errors [rad] of joint 1 after a step of 0.5 rad from rest in the middle."""
    times = np.arange(0, 3, STEP)
    target = jnp.full(len(times), 0.5)
    still = Reference(target, jnp.zeros(len(times)), jnp.zeros(len(times)))
    machine, found = robot_joint(INERTIAS[0]), {}
    for fuzzy, name in ((False, "variable structure"), (True, "fuzzy PID")):
        controller = tuned(1, fuzzy).controller
        loop = feedback_on(machine, controller)
        moved = closed_loop(
            machine, loop, target if fuzzy else still, times, begin=loop.start(0.5), start=posture(0.0)
        )
        found[name] = times, 0.5 - np.asarray(moved.readings["angle"])
    return found
