"""Scenes of rigs of one muscle: the lift, the test machine, the elbow."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from jaxmuscle.actuators import Driven, Elbow, Isotonic
from jaxmuscle.animation.drawn_parts import (
    CELL,
    GROUND,
    HOSE,
    METAL,
    arrow,
    box,
    regulator,
    text,
    valve,
    wall,
)
from jaxmuscle.animation.muscle_shape import draw_bladder, draw_muscle
from jaxmuscle.animation.scenes import Moment, Scene, scene
from jaxmuscle.figure_style import AFTER, INK
from jaxmuscle.formatting import quantity


@scene.register
def lift_scene(actuator: Isotonic) -> Scene:
    """The muscle hangs from a frame; the mass below it stands on the base plate at contraction 0."""
    muscle, length = actuator.muscle, float(actuator.muscle.initial_length)
    size = 0.16 * length
    full = float(actuator.valve.full_command)

    def draw(axes: Axes, now: Moment, level: Mapping[str, float]) -> None:
        lift = now["position"]
        wall(axes, (-0.26 * length, length), (0.26 * length, length), 0.03 * length)
        box(axes, -0.3 * length, -size - 0.03 * length, 0.6 * length, 0.03 * length, GROUND)
        box(axes, -size / 2, lift - size, size, size, METAL, edgecolor=INK, zorder=3)
        text(axes, 0, lift - size / 2, quantity(float(actuator.mass), "kg"), color="white", fontweight="bold")
        draw_muscle(axes, muscle, np.array([0.0, lift]), np.array([0.0, length]), level["pressure"])
        opening = now.get("command", 0.0) / full
        valve(axes, 0.18 * length, 1.03 * length, 0.13 * length, opening)

    r = float(muscle.initial_radius)
    labels = (
        (-0.25 * length, 0.55 * length, f"l₀ = {quantity(length, 'm', 3)}\nr₀ = {quantity(r, 'm', 3)}\n"
                                        f"α₀ = {quantity(float(muscle.braid_angle), 'rad', 3)}"),
        (0.27 * length, -0.07 * length, f"m = {quantity(float(actuator.mass), 'kg', 3)}"),
        (0.25 * length, 1.22 * length, f"valve {quantity(float(actuator.valve.area), 'm^2', 3)}"),
    )  # fmt: skip
    rest = {"position": 0.0, "pressure": float(actuator.ambient_pressure), "command": 0.0}
    limits = ((-0.42 * length, 0.42 * length), (-0.24 * length, 1.26 * length))
    return Scene("position", ("pressure",), rest, limits, draw, labels)


@scene.register
def driven_scene(actuator: Driven) -> Scene:
    """The muscle lies between a load cell and the crosshead of a test machine, which moves."""
    muscle, length = actuator.muscle, float(actuator.muscle.initial_length)
    wide = 0.14 * length

    def draw(axes: Axes, now: Moment, level: Mapping[str, float]) -> None:
        end = length - now["position"]
        box(axes, -0.14 * length, -wide, 0.09 * length, 2 * wide, GROUND)
        box(axes, -0.05 * length, -0.05 * length, 0.05 * length, 0.1 * length, CELL)
        box(axes, end, -wide, 0.07 * length, 2 * wide, METAL, edgecolor=INK)
        axes.plot([-0.14 * length, 1.16 * length], [-wide, -wide], color=GROUND, linewidth=2)
        draw_muscle(axes, muscle, np.array([0.0, 0.0]), np.array([end, 0.0]), level["pressure"])
        if "force" in now and math.isfinite(now["force"]):
            pull, side = 0.3 * length * now["force"] / strength, end + 0.07 * length
            arrow(axes, side, 0.0, max(pull, 0.0), 0.03 * length)
            shown = quantity(now["force"], "N", 3)
            text(axes, side + 0.02 * length, 0.09 * length, shown, ha="left", color=AFTER)

    area = math.pi * float(muscle.initial_radius) ** 2
    strength = area * 5e5 * (3 / math.tan(float(muscle.braid_angle)) ** 2)
    labels = (
        (0.5 * length, 0.16 * length, f"l₀ = {quantity(length, 'm', 3)}    "
                                      f"r₀ = {quantity(float(muscle.initial_radius), 'm', 3)}    "
                                      f"α₀ = {quantity(float(muscle.braid_angle), 'rad', 3)}"),
        (-0.08 * length, 0.2 * length, "load cell"),
        (1.04 * length, -0.2 * length, "crosshead"),
    )  # fmt: skip
    rest = {"position": 0.0, "pressure": float(actuator.ambient_pressure)}
    limits = ((-0.2 * length, 1.45 * length), (-0.34 * length, 0.34 * length))
    return Scene("position", ("pressure",), rest, limits, draw, labels)


@scene.register
def elbow_scene(actuator: Elbow) -> Scene:
    """Upper arm, forearm and a muscle between them; the rig has no dimensions, so that all is a sketch."""
    upper, reach, slack = 1.0, 0.28, 0.75

    def draw(axes: Axes, now: Moment, level: Mapping[str, float]) -> None:
        bend = now["angle"]
        forearm = np.array([math.sin(bend), -math.cos(bend)])
        axes.plot([0, 0], [upper, 0], color=METAL, linewidth=12, solid_capstyle="round", zorder=1)
        axes.plot([0, 0.95 * forearm[0]], [0, 0.95 * forearm[1]], color=METAL, linewidth=10, zorder=1)
        begin, end = np.array([0.13, 0.95 * upper]), reach * forearm + np.array([0.06, 0.0])
        rope = begin + (end - begin) * slack
        swollen = 0.07 + 0.06 * level["pressure"]
        axes.plot([rope[0], end[0]], [rope[1], end[1]], color=INK, linewidth=1.6, zorder=2)
        draw_bladder(axes, begin, rope, swollen, 0.05, 1.5, level["pressure"])
        regulator(axes, 0.5, 0.98 * upper, 0.1, level.get("command", 0.0))
        axes.plot([0.13, 0.42], [0.98 * upper] * 2, color=HOSE, linewidth=3, zorder=1.5)
        axes.add_patch(Circle((0.0, 0.0), 0.09, color=INK, zorder=6))
        hand = 0.95 * forearm
        axes.add_patch(Circle((float(hand[0]), float(hand[1])), 0.09, color=AFTER, zorder=5))

    rest = {"angle": 0.0, "pressure": float(actuator.ambient_pressure)}
    labels = ((0.75, 0.75, "muscle: a sketch,\nthe rig has\nno dimensions"),)
    return Scene("angle", ("pressure",), rest, ((-0.45, 1.25), (-1.2, 1.2)), draw, labels)
