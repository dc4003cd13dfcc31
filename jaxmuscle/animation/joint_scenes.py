"""Scenes of joints between opposed muscles: one joint, and the arm of two."""

from __future__ import annotations

import math
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon
from numpy.typing import NDArray

from jaxmuscle.actuators.joint import AbstractOpposedMuscles
from jaxmuscle.animation.drawn_parts import CELL, GROUND, METAL, note, regulator, text, wall
from jaxmuscle.animation.opposed_muscles import OpposedMuscles, levels_of
from jaxmuscle.animation.scenes import Moment, Scene, scene
from jaxmuscle.components.antagonist import joint_range
from jaxmuscle.figure_style import AFTER, INK, MUTED
from jaxmuscle.formatting import quantity
from jaxmuscle.robot.kinematics import elbow_point, tip
from jaxmuscle.robot.scara import Scara

THICKER = 3.0
"""How many times as thick the robot's muscles are drawn: beside its links they would be threads."""
MUSCLES = 4
"""Muscles of the robot."""


@scene.register
def joint_scene(actuator: AbstractOpposedMuscles) -> Scene:
    """Two muscles from a wall pull the ends of a chain around the sprocket, which carries an arm."""
    pair = OpposedMuscles(actuator)
    length, radius, left = pair.length, pair.sprocket, pair.begin
    arm = max(6 * radius, 0.3 * length)

    def draw(axes: Axes, now: Moment, level: Mapping[str, float]) -> None:
        angle = now["angle"]
        wall(axes, (left, -0.13 * length), (left, 0.13 * length), -0.03 * length)
        pair.draw(axes, angle, levels_of(level, 1))
        for i, apart in enumerate(pair.apart):
            regulator(axes, left - 0.09 * length, apart, 0.05 * length, level.get(f"command_{i + 1}", 0.0))
        end = arm * np.array([math.cos(angle), math.sin(angle)])
        axes.plot([0.0, end[0]], [0.0, end[1]], color=AFTER, linewidth=5, solid_capstyle="round", zorder=5)
        axes.add_patch(Circle((0.0, 0.0), 0.35 * radius, color=INK, zorder=6))
        axes.plot([0.0, arm], [0.0, 0.0], color=MUTED, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)

    labels = (
        (0.5 * left, 0.24 * length, pair.dimensions()),
        (0.3 * arm, -0.2 * length, f"R = {quantity(radius, 'm', 3)}    "
                                   f"J = {quantity(float(actuator.inertia), 'kg m^2', 3)}"),
        (left + 0.12 * length, pair.apart[0] + 2 * pair.widest, "muscle 1"),
        (left + 0.12 * length, pair.apart[1] - 2 * pair.widest, "muscle 2"),
    )  # fmt: skip
    ambient = float(actuator.ambient_pressure)
    rest = {"angle": 0.0, "pressure_1": ambient, "pressure_2": ambient}
    high = max(1.05 * arm, 0.3 * length)
    limits = ((left - 0.2 * length, 1.1 * arm), (-high, high))
    return Scene("angle", ("pressure_1", "pressure_2"), rest, limits, draw, labels)


@scene.register
def robot_scene(actuator: Scara) -> Scene:
    """The arm from above: two links, the muscles of joint 1 on a wall, those of joint 2 along link 1.

    Dotted is how far the tip reaches to the outside, a block at the tip the payload, hatched the pane, which
    turns the roller at the tip red where it presses.
    """
    pair, arm = OpposedMuscles(actuator, THICKER), actuator.arm
    reach = reach_of(actuator)
    size = 0.03 * float(arm.first.length + arm.second.length)
    limits = _limits(pair, reach)
    wide = 2.4 * pair.widest

    def draw(axes: Axes, now: Moment, level: Mapping[str, float]) -> None:
        angle = np.array([now["angle_1"], now["angle_2"]])
        elbow, end = (np.asarray(place(arm, jnp.asarray(angle))) for place in (elbow_point, tip))
        axes.plot(*reach.T, color=MUTED, linewidth=0.8, linestyle=":", zorder=0.5)
        wall(axes, (pair.begin, -wide), (pair.begin, wide), -0.03 * pair.length)
        for i in range(MUSCLES):
            y = (1.5 - i) * 2 * wide / MUSCLES * 1.3
            regulator(axes, pair.begin - 0.12 * pair.length, y, 0.5 * wide / MUSCLES,
                      level.get(f"command_{i + 1}", 0.0))  # fmt: skip
        for begin, far in ((np.zeros(2), elbow), (elbow, end)):
            axes.plot(*np.stack([begin, far]).T, color=METAL, linewidth=6, solid_capstyle="round", zorder=1.8)
        pair.draw(axes, angle[0], levels_of(level, 1))
        pair.draw(axes, angle[1], levels_of(level, 3), elbow, angle[0])
        touches = _draw_pane(axes, actuator, end)
        payload = float(arm.payload)
        if payload > 0:
            text(axes, end[0], end[1] - 2.4 * size, quantity(payload, "kg"), color=INK)
        colour = AFTER if touches else INK if payload > 0 else CELL
        axes.add_patch(Circle((end[0], end[1]), size if payload > 0 else 0.6 * size, color=colour, zorder=6))
        note(axes, f"muscles are drawn {THICKER:g} times as thick")

    ambient = float(actuator.ambient_pressure)
    pressures = tuple(f"pressure_{i + 1}" for i in range(MUSCLES))
    rest = {"angle_1": 0.0, "angle_2": 0.0} | dict.fromkeys(pressures, ambient)
    return Scene("angle_1", ("angle_2", *pressures), rest, limits, draw, _labels(actuator, pair))


def reach_of(robot: Scara) -> NDArray[np.float64]:
    """Places (points, 2) of the tip with joint 2 straight, and with joint 1 at an end and joint 2 bending."""
    largest = float(joint_range(robot.muscle, robot.sprocket_radius, robot.initial_contraction))
    sweep, bent = np.linspace(-largest, largest, 60), np.linspace(0.0, largest, 30)
    end = np.full_like(bent, largest)
    parts = [
        np.stack([-end, -bent[::-1]], 1),
        np.stack([sweep, np.zeros_like(sweep)], 1),
        np.stack([end, bent], 1),
    ]
    return np.asarray(tip(robot.arm, jnp.asarray(np.concatenate(parts))))


def _limits(pair: OpposedMuscles, reach: NDArray) -> tuple[tuple[float, float], tuple[float, float]]:
    """What is to be seen: wherever the tip gets, and the muscles on the wall."""
    margin = 0.16 * pair.length
    low, high = reach.min(axis=0) - margin, reach.max(axis=0) + margin
    # Below there is place for the note.
    return (min(low[0], pair.begin - 0.25 * pair.length), high[0]), (low[1] - margin, high[1])


def _draw_pane(axes: Axes, robot: Scara, end: NDArray) -> bool:
    """The pane, where there is one; whether the tip presses on it."""
    pane = robot.pane
    if float(pane.stiffness) == 0:
        return False
    normal = np.array([math.cos(float(pane.normal)), math.sin(float(pane.normal))])
    along = np.array([-normal[1], normal[0]])
    reach, near = float(robot.arm.first.length + robot.arm.second.length), float(pane.distance) * normal
    corners = np.array([near - reach * along, near + reach * along])
    slab = np.concatenate([corners, corners[::-1] + 0.05 * reach * normal])
    axes.add_patch(
        Polygon(slab, facecolor="#dbe7f3", edgecolor=GROUND, hatch="////", linewidth=0.8, zorder=1)
    )
    return float(pane.penetration(jnp.asarray(end))) > 0


def _labels(robot: Scara, pair: OpposedMuscles) -> tuple[tuple[float, float, str], ...]:
    first, second = robot.arm.first, robot.arm.second
    reach, high = float(first.length), 2 * pair.widest + 0.1 * pair.length
    labels = [
        (0.5 * pair.begin, high, "muscles 1, 2"),
        (0.5 * reach, high, "muscles 3, 4"),
        (0.5 * reach, -high, f"l₁ = {quantity(reach, 'm', 3)}, {quantity(float(first.mass), 'kg', 3)}"),
        (reach + 0.5 * float(second.length), high,
         f"l₂ = {quantity(float(second.length), 'm', 3)}, {quantity(float(second.mass), 'kg', 3)}"),
        (0.0, -1.9 * high, f"R = {quantity(pair.sprocket, 'm', 3)}    {pair.dimensions()}"),
    ]  # fmt: skip
    return tuple(labels)
