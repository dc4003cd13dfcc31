"""The robot of [T] in closed loop: along a straight line with loads, and against a pane."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
from closed_loop_joint import GAINS, NO_NOISE, STEP, TRADED, tuned
from published_rows import OWN, WORDS, Row, aside, assuming, at_most, row

import jaxmuscle as jm
from jaxmuscle.control import IndependentJoints, Reference, closed_loop, independent_joints
from jaxmuscle.robot import Motion, Pane, joints_along, line, pressure_commands, robot, tip
from jaxmuscle.robot.tondu2000 import MEAN_PRESSURE

LOADS, TUNED_LOADS = (0.0, 0.5, 1.0, 1.5), (0.0, 1.0)
TIGHTER = 0.3
"""Error of the tip that costs one when both joints are tuned together, of that by the gains of each alone."""
BEHIND = 5e-3
"""How far behind the pane the line runs [m]; "a few millimetres" in [T]."""


@cache
def controllers(fuzzy: bool) -> IndependentJoints:
    """Those that were tuned on each joint alone."""
    return independent_joints(
        robot(), [tuned(joint, fuzzy)[0] for joint in (1, 2)], mean_pressure=MEAN_PRESSURE
    )


def way_of_tip(speed: float) -> Motion:
    """What the joints are to do while the tip goes from A to B."""
    way = line([0.7, 0.3], [-0.1, 0.7], speed, speed)
    return joints_along(robot().arm, way.at(np.arange(0, float(way.duration), STEP)), 1)


@cache
def along_the_line() -> jm.tuning.Tuning:
    """The gains of both joints tuned together, by the error of the tip along the line at 0.5 m/s.

    They begin at those of each joint alone, whose rate of the commands costs one, and a share of whose error.
    """
    known, motion = robot(), way_of_tip(0.5)
    times = np.arange(len(motion.position)) * STEP
    start = {"angle": motion.position[0], "pressure": pressure_commands(known, motion)[0]}
    payloads = {"payload": list(TUNED_LOADS)}
    scenarios = jm.tuning.grid(Reference(*motion), times, payloads, start=start)
    error, rate = [], []
    for load in TUNED_LOADS:
        run = along(robot(load), motion)
        wanted = tip(known.arm, motion.position)
        error.append(float(jnp.sum((tip(known.arm, run.readings["angle"]) - wanted) ** 2, axis=1).mean()))
        rate.append(float(jnp.mean((jnp.diff(run.commands, axis=0) / STEP) ** 2)))
    sizes = (float(np.sqrt(np.mean(squares))) for squares in (error, rate))
    goal = jm.tuning.tip_error(known.arm, TIGHTER * next(sizes), next(sizes))
    return jm.tune(known, controllers(False), scenarios, goal, starts=1, steps=15)


def along(machine: Any, motion: Any, fuzzy: bool = False, together: bool = False) -> Any:
    """A run of the robot along a motion of its joints; `together`: with gains tuned along the line."""
    loop = along_the_line().controller if together else controllers(fuzzy)
    begin = {"angle": motion.position[0], "pressure": pressure_commands(robot(), motion)[0]}
    times = np.arange(len(motion.position)) * STEP
    return closed_loop(machine, loop, motion.position if fuzzy else Reference(*motion), times, start=begin)


@cache
def straight(
    load: float, speed: float = 0.1, fuzzy: bool = False, together: bool = False
) -> tuple[float, float, float, float]:
    """Mean and largest distance from the path, and from where the tip should be [mm], from A to B."""
    way = line([0.7, 0.3], [-0.1, 0.7], speed, speed)
    wanted = way.at(np.arange(0, float(way.duration), STEP))
    known = robot()
    angle = along(robot(load), joints_along(known.arm, wanted, 1), fuzzy, together).readings["angle"]
    off = 1e3 * np.asarray(tip(known.arm, angle) - wanted.position)
    across, size = np.abs(off @ (np.array([0.4, 0.8]) / np.hypot(0.4, 0.8))), np.linalg.norm(off, axis=1)
    return float(across.mean()), float(across.max()), float(size.mean()), float(size.max())


@cache
def wiping(fuzzy: bool) -> tuple[float, float]:
    """Largest contact force, and force at the end of a rest of 5 s behind the pane [N]."""
    known = robot()
    way = line([0.6 + BEHIND, -0.2], [0.6 + BEHIND, 0.25], 0.1, 0.1)
    motion = joints_along(known.arm, way.at(np.arange(0, float(way.duration) + 5.0, STEP)), 1)
    kind: Any = Pane
    pane = kind(stiffness=2e3, damping=1.0, normal=0.0, distance=0.6)
    found = along(dataclasses.replace(known, pane=pane), motion, fuzzy)
    where = tip(known.arm, found.readings["angle"])
    force = np.asarray(pane.pressing(where, jnp.zeros_like(where)))
    return float(force.max()), float(force[-1])


def together_rows() -> Iterator[Row]:
    """Gains tuned along the line with two loads, beside those of each joint alone, with loads not seen."""
    made = along_the_line()
    print(f"    both joints along the line: cost {made.before.cost:.3g} to {made.after.cost:.3g}; "
          + ", ".join(f"{name} {value:.3g}" for name, value in made.values.items()))  # fmt: skip
    unseen = [load for load in LOADS if load not in TUNED_LOADS]
    shares = [
        straight(load, speed, together=True)[2] / straight(load, speed)[2]
        for load in unseen
        for speed in (0.1, 0.5)
    ]
    entry = row("[T] control", "both joints tuned along the line over each alone: mean tracking error of the "
                "tip, loads not tuned on, at 0.1 and 0.5 m/s", "tuned by hand", shares, max(shares) <= 1, "",
                "not more", "gradient descent through the loop of the whole robot",
                "tuned at 0.5 m/s with two loads")  # fmt: skip
    yield aside(entry, OWN)


def robot_rows() -> Iterator[Row]:
    source, names = "[T] Figure 20", ("path deviation, mean", "path deviation, largest",
                                      "tracking error, mean", "tracking error, largest")  # fmt: skip
    for name, ours, goal in zip(names, straight(0.0), ("2.5", "8", "3.3", "11"), strict=True):
        figure = f"closed loop from A to B at 0.1 m/s: {name}"
        yield assuming(at_most(source, figure, goal, ours, "mm", NO_NOISE, TRADED), GAINS)
    means = [straight(load, speed)[0] for load in LOADS for speed in (0.1, 0.5)]
    loaded = row("[T] Figure 21", "closed loop: mean path deviation, 0, 0.5, 1, 1.5 kg at 0.1 and 0.5 m/s",
                 "3 to 6", means, max(means) <= 6.0, "mm", "not more than 6", NO_NOISE,
                 "gains of the joints alone, tuned at 0.5 rad/s without a load")  # fmt: skip
    yield assuming(loaded, GAINS)
    yield from together_rows()
    both = [straight(load, 0.1, True)[0] / straight(load)[0] for load in LOADS]
    robust = row("[T] control", "fuzzy PID over variable structure: mean path deviation with those loads",
                 "almost as robust", both, max(both) < 2, "", "< 2", "in words; its gains are not given",
                 "it knows no model of the joints")  # fmt: skip
    yield aside(robust, WORDS)
    force = [wiping(fuzzy) for fuzzy in (False, True)]
    ends = [after for _, after in force]
    print(f"    leaning {1e3 * BEHIND:g} mm behind a pane: largest force {force[0][0]:.1f} N by variable "
          f"structure, {force[1][0]:.1f} N by fuzzy PID")  # fmt: skip
    left = row("[T] Figure 23", "force left on the pane after a rest of 5 s: variable structure, fuzzy PID",
               "fuzzy PID unadapted: its integral costs the compliance", ends, ends[1] > ends[0], "N",
               "fuzzy PID more", "in words",
               "the integrator of the variable structure acts there too")  # fmt: skip
    yield aside(left, WORDS)
