"""The robot of [T] wipes a pane: gains tuned through the contact, on panes that no tuning has seen.

The joints are told a line well behind the pane. Gains that follow it exactly press too hard; the force is to
be a smaller one, so that the joints have to give way, which is what [T] praises pneumatic muscles for.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterator
from functools import cache
from typing import Any

import jax.numpy as jnp
import numpy as np
from closed_loop_joint import STEP
from numpy.typing import NDArray
from published_rows import OWN, Row, aside, row

import jaxmuscle as jm
from jaxmuscle.control import PID, ClosedLoop, IndependentJoints, Reference, closed_loop, independent_joints
from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.robot import Motion, Pane, joints_along, line, pressure_commands, robot, tip
from jaxmuscle.robot.tondu2000 import MEAN_PRESSURE

DISTANCE, BEHIND, DAMPING = 0.6, 0.02, 1.0
"""Of the pane from the base and of the line from the pane [m]; damping of the contact [s/m]."""
STIFFNESS = 2e3
"""Of a pane [N/m]: followed exactly, the line means 40 N."""
FORCE, LOOSE, ALONG = 10.0, 1.0, 5e-3
"""Force with which the tip is to lean on the pane, error of it that costs one [N], distance along it that
does [m]."""
SETTLED = 0.5
"""Time after which the force counts [s]: the robot begins at rest where it touches the pane."""
SPEED = 0.1
"""Along the pane where gains are tuned [m/s]."""
TUNED_ON = {"pane.stiffness": [0.8e3, 5e3], "payload": [0.0, 1.0]}
UNSEEN = {"stiffness": (1e3, 2e3, 4e3), "speed": (0.06, 0.2), "payload": (0.5,)}
"""Panes [N/m] and payloads [kg] of the tuning; those of the last word, with speeds."""


HAND_SET = (5e5, 1e6, 5e4), (1.5e5, 3e5, 1.5e4)
"""Gains of the PID of each joint at which the descent begins: round numbers, tuned on nothing."""


def by_hand() -> IndependentJoints:
    """A PID for each joint."""
    kind: Any = PID
    return independent_joints(robot(), [kind(*gains) for gains in HAND_SET], mean_pressure=MEAN_PRESSURE)


def leaning(stiffness: float = STIFFNESS, payload: float = 0.0) -> Any:
    """The robot with a pane."""
    kind: Any = Pane
    pane = kind(stiffness=stiffness, damping=DAMPING, normal=0.0, distance=DISTANCE)
    return dataclasses.replace(robot(payload), pane=pane)


def wiped(speed: float, behind: float = BEHIND) -> Motion:
    """What the joints are told: a line behind the pane."""
    where = DISTANCE + behind
    way = line([where, -0.1], [where, 0.15], speed, 1.0)
    return joints_along(robot().arm, way.at(np.arange(0, float(way.duration), STEP)), 1)


def at_the_pane(speed: float) -> dict[str, Any]:
    """At rest where the tip touches the pane."""
    touching = wiped(speed, 0.0)
    return {"angle": touching.position[0], "pressure": pressure_commands(robot(), touching)[0]}


def force_on(machine: Any, run: ClosedLoop) -> Any:
    """Force on the pane [N], without that of its damping."""
    where = tip(machine.arm, run.readings["angle"])
    return machine.pane.pressing(where, jnp.zeros_like(where))


def leaning_error(variation: float) -> Any:
    """What a wipe costs: error of the force, way along the pane, rate of the commands [Pa/s]."""

    def of(run: ClosedLoop, reference: Any, machine: Any) -> Any:
        off = jnp.where(run.time > SETTLED, force_on(machine, run) - FORCE, 0.0) / LOOSE
        there, wanted = (tip(machine.arm, x)[:, 1] for x in (run.readings["angle"], target_of(reference)))
        rate = jnp.diff(run.commands, axis=0) / STEP / variation
        parts = off, (there - wanted) / ALONG, rate.ravel()
        return jnp.concatenate([part / jnp.sqrt(len(part)) for part in parts])

    return of


def run_of(loop: Any, stiffness: float, speed: float, payload: float) -> ClosedLoop:
    """A wipe by a controller of the robot."""
    motion = wiped(speed)
    times = np.arange(len(motion.position)) * STEP
    machine = leaning(stiffness, payload)
    return closed_loop(machine, loop, Reference(*motion), times, start=at_the_pane(speed))


def wipe(loop: Any, stiffness: float, speed: float, payload: float) -> NDArray[np.float64]:
    """Root mean square errors of a wipe: of the force [N], and along the pane [mm]."""
    run, wanted = run_of(loop, stiffness, speed, payload), wiped(speed).position
    force = np.asarray(force_on(leaning(stiffness), run))[np.asarray(run.time) > SETTLED]
    off = np.asarray(tip(robot().arm, run.readings["angle"]) - tip(robot().arm, wanted))[:, 1]
    return np.array([np.sqrt(np.mean(x**2)) for x in (force - FORCE, 1e3 * off)])


@cache
def tuned_through_contact() -> jm.tuning.Tuning:
    """Gains of both joints, begun at those that are set by hand."""
    loop, motion = by_hand(), wiped(SPEED)
    times = np.arange(len(motion.position)) * STEP
    scenarios = jm.tuning.grid(Reference(*motion), times, TUNED_ON, start=at_the_pane(SPEED))
    commands = [np.asarray(run_of(loop, *own).commands) for own in itertools.product(
        TUNED_ON["pane.stiffness"], [SPEED], TUNED_ON["payload"]
    )]  # fmt: skip
    size = float(np.sqrt(np.mean([np.mean(np.diff(c, axis=0) ** 2) for c in commands])) / STEP)
    return jm.tune(leaning(), loop, scenarios, leaning_error(size), starts=2, steps=25)


def pane_rows() -> Iterator[Row]:
    """Errors on panes, at speeds and with a payload that were not tuned on, beside those of gains by hand."""
    made, hand = tuned_through_contact(), by_hand()
    print(f"    through contact: cost {made.before.cost:.3g} to {made.after.cost:.3g}; "
          + ", ".join(f"{name} {value:.3g}" for name, value in made.values.items()))  # fmt: skip
    shares, size = [], np.array([LOOSE, 1e3 * ALONG])
    for run in itertools.product(*UNSEEN.values()):
        before, after = wipe(hand, *run), wipe(made.controller, *run)
        shares.append(float(np.linalg.norm(after / size) / np.linalg.norm(before / size)))
        print(f"    pane of {run[0]:g} N/m at {run[1]:g} m/s with {run[2]:g} kg: force off {before[0]:.2f}, "
              f"tuned {after[0]:.2f} N; along it {before[1]:.1f} mm, tuned {after[1]:.1f} mm")  # fmt: skip
    entry = row("[T] control", f"leaning on a pane with {FORCE:g} N while wiping it: errors of force and way "
                "after tuning through the contact over those by hand, panes and speeds not tuned on",
                "compliance on contact", shares, max(shares) <= 1, "", "not more",
                "gradient descent through the loop of the whole robot and the contact",
                "tuned on a softer and a stiffer pane")  # fmt: skip
    yield aside(entry, OWN)
