"""The robot of [T] in closed loop: along a straight line with loads, and against a pane."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import cache
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from closed_loop_joint import AMBIENT, GAINS, NO_NOISE, STEP, TRADED, tuned
from published_rows import WORDS, Row, aside, assuming, at_most, row

from jaxmuscle.control import Reference, closed_loop
from jaxmuscle.robot import Pane, joints_along, line, pressure_commands, robot, tip
from jaxmuscle.robot.scara import PULLS
from jaxmuscle.robot.tondu2000 import MEAN_PRESSURE

LOADS = (0.0, 0.5, 1.0, 1.5)
BEHIND = 5e-3
"""How far behind the pane the line runs [m]; "a few millimetres" in [T]."""


class TwoJoints(eqx.Module):
    """A controller for each joint, side by side: ΔU of a joint on its two muscles."""

    joints: Any

    def start(self) -> Any:
        return jax.vmap(lambda joint: joint.start())(self.joints)

    def update(self, state: Any, wanted: Any, readings: Any, step: Any) -> Any:
        state, output = jax.vmap(lambda c, s, w, y: c.update(s, w, y, step))(
            self.joints, state, wanted, readings["angle"]
        )
        command = AMBIENT + MEAN_PRESSURE + output @ PULLS
        return state, jnp.clip(command, AMBIENT, AMBIENT + 2 * MEAN_PRESSURE)


@cache
def controllers(fuzzy: bool) -> TwoJoints:
    """Those that were tuned on each joint alone."""
    return TwoJoints(jax.tree.map(lambda *leaves: jnp.stack(leaves), *(tuned(j, fuzzy)[0] for j in (1, 2))))


def along(machine: Any, motion: Any, fuzzy: bool = False) -> Any:
    """A run of the robot along a motion of its joints."""
    loop = controllers(fuzzy)
    begin = {"angle": motion.position[0], "pressure": pressure_commands(robot(), motion)[0]}
    times = np.arange(len(motion.position)) * STEP
    return closed_loop(machine, loop, motion.position if fuzzy else Reference(*motion), times, start=begin)


@cache
def straight(load: float, speed: float = 0.1, fuzzy: bool = False) -> tuple[float, float, float, float]:
    """Mean and largest distance from the path, and from where the tip should be [mm], from A to B."""
    way = line([0.7, 0.3], [-0.1, 0.7], speed, speed)
    wanted = way.at(np.arange(0, float(way.duration), STEP))
    known = robot()
    angle = along(robot(load), joints_along(known.arm, wanted, 1), fuzzy).readings["angle"]
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
