"""What is to be seen of each rig: where its parts are, and how they lie at a moment of a run."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from functools import singledispatch
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, FancyArrow, Rectangle

from jaxmuscle.actuators import Driven, Elbow, Isotonic
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.actuators.joint import SIDES, AbstractOpposedMuscles
from jaxmuscle.animation.muscle_shape import draw_bladder, draw_muscle, radius_at
from jaxmuscle.components.mckibben import largest_contraction
from jaxmuscle.effects.transmission import winding
from jaxmuscle.errors import InputError
from jaxmuscle.figure_style import AFTER, INK, MUTED
from jaxmuscle.formatting import quantity

Moment = Mapping[str, float]
"""Column → its value (SI, pressures absolute); ``level`` of each pressure column is a part of the highest."""
METAL, GROUND, HOSE, CELL = "#9aa3af", "#4b5563", "#6f8fb8", "#c9a24a"


@dataclasses.dataclass(frozen=True)
class Scene:
    """How a rig is drawn.

    Attributes:
        motion: column that moves it; other columns that are needed: `needed`.
        rest: moment at which :func:`jaxmuscle.draw` shows it.
        limits: (left, right), (bottom, top) of what is to be seen [m].
        draw: puts the parts at a moment into axes; pressures are given as levels beside their columns,
            ``level(column)`` as a part of the highest.
        labels: place and text of each dimension.
    """

    motion: str
    needed: tuple[str, ...]
    rest: Moment
    limits: tuple[tuple[float, float], tuple[float, float]]
    draw: Callable[[Axes, Moment, Mapping[str, float]], None]
    labels: tuple[tuple[float, float, str], ...] = ()


@singledispatch
def scene(actuator: AbstractActuator) -> Scene:
    """The scene of a machine; ``scene.register`` takes one for a rig of your own.

    Raises:
        InputError: nothing is said of how this rig looks.
    """
    known = ", ".join(sorted(kind.__name__ for kind in scene.registry if kind is not object))
    rig = getattr(actuator, "rig", type(actuator).__name__)
    raise InputError(
        f"nothing is said of how rig {rig!r} looks; known: {known}. For your own define a function from the "
        f"machine to a jaxmuscle.animation.Scene, decorated with @jaxmuscle.animation.scene.register"
    )


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
        valve(axes, 0.18 * length, 1.03 * length, 0.13 * length, opening, both=True)

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
def joint_scene(actuator: AbstractOpposedMuscles) -> Scene:
    """Two muscles from a wall pull the ends of a chain around the sprocket, which carries an arm."""
    muscle, length = actuator.muscle, float(actuator.muscle.initial_length)
    radius = float(actuator.sprocket_radius)
    middle = float(actuator.initial_contraction) * length
    widest = radius_at(muscle, float(largest_contraction(muscle)))
    apart = np.array([1.0, -1.0]) * max(radius, 1.3 * widest)
    left = -(length + 2.5 * radius + 0.05 * length)
    arm = max(6 * radius, 0.3 * length)

    def draw(axes: Axes, now: Moment, level: Mapping[str, float]) -> None:
        angle = now["angle"]
        wound = float(winding(actuator.effects, jnp.asarray(angle)))
        shortened = middle + radius * wound * SIDES
        wall(axes, (left, -0.13 * length), (left, 0.13 * length), -0.03 * length)
        for i, side in enumerate(SIDES):
            end = np.array([left + length - shortened[i], apart[i]])
            axes.plot([end[0], 0.0], [end[1], radius * side], color=INK, linewidth=1.6, zorder=2)
            draw_muscle(axes, muscle, np.array([left, apart[i]]), end, level[f"pressure_{i + 1}"])
            regulator(axes, left - 0.09 * length, apart[i], 0.05 * length, level.get(f"command_{i + 1}", 0.0))
        axes.add_patch(Circle((0.0, 0.0), radius, facecolor=METAL, edgecolor=INK, zorder=4))
        tip = arm * np.array([math.cos(angle), math.sin(angle)])
        axes.plot([0.0, tip[0]], [0.0, tip[1]], color=AFTER, linewidth=5, solid_capstyle="round", zorder=5)
        axes.add_patch(Circle((0.0, 0.0), 0.35 * radius, color=INK, zorder=6))
        axes.plot([0.0, arm], [0.0, 0.0], color=MUTED, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)

    r0 = float(muscle.initial_radius)
    labels = (
        (0.5 * left, 0.24 * length, f"l₀ = {quantity(length, 'm', 3)}    r₀ = {quantity(r0, 'm', 3)}    "
                                    f"α₀ = {quantity(float(muscle.braid_angle), 'rad', 3)}"),
        (0.3 * arm, -0.2 * length, f"R = {quantity(radius, 'm', 3)}    "
                                   f"J = {quantity(float(actuator.inertia), 'kg m^2', 3)}"),
        (left + 0.12 * length, apart[0] + 2 * widest, "muscle 1"),
        (left + 0.12 * length, apart[1] - 2 * widest, "muscle 2"),
    )  # fmt: skip
    ambient = float(actuator.ambient_pressure)
    rest = {"angle": 0.0, "pressure_1": ambient, "pressure_2": ambient}
    high = max(1.05 * arm, 0.3 * length)
    limits = ((left - 0.2 * length, 1.1 * arm), (-high, high))
    return Scene("angle", ("pressure_1", "pressure_2"), rest, limits, draw, labels)


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


def box(axes: Axes, x: float, y: float, wide: float, high: float, colour: str, **look: Any) -> None:
    """A block with its lower left corner at a place."""
    axes.add_patch(Rectangle((x, y), wide, high, **{"facecolor": colour, "edgecolor": "none", **look}))


def wall(axes: Axes, begin: tuple[float, float], end: tuple[float, float], depth: float) -> None:
    """A wall along a line, to the side on which `depth` lies."""
    (x, y), (u, v) = begin, end
    wide, high = (u - x, depth) if y == v else (depth, v - y)
    box(axes, x, y, wide, high, GROUND, zorder=1)


def text(axes: Axes, x: float, y: float, words: str, **look: Any) -> None:
    """A small text at a place."""
    axes.text(x, y, words, **{"ha": "center", "va": "center", "fontsize": 8.5, "zorder": 7, **look})


def arrow(axes: Axes, x: float, y: float, length: float, width: float) -> None:
    """An arrow to the right."""
    if length > 0:
        head: dict[str, Any] = {"head_width": 2.2 * width, "head_length": min(2 * width, length)}
        body: dict[str, Any] = {"width": width, "length_includes_head": True, "color": AFTER, "zorder": 6}
        axes.add_patch(FancyArrow(x, y, length, 0.0, **body, **head))


def regulator(axes: Axes, x: float, y: float, half: float, level: float) -> None:
    """A pressure regulator about a place: the bar is the pressure that is commanded."""
    box(axes, x - half, y - half, 2 * half, 2 * half, "white", edgecolor=INK, zorder=3)
    box(axes, x - half, y - half, 2 * half, 2 * half * min(max(level, 0.0), 1.0), AFTER, zorder=4)


def valve(axes: Axes, x: float, y: float, size: float, opening: float, both: bool) -> None:
    """A valve with its hose: the bar is the command, to the right filling and to the left venting."""
    axes.plot([0.0, 0.0, x], [y, y + size / 2, y + size / 2], color=HOSE, linewidth=3, zorder=1.5)
    box(axes, x, y, 1.6 * size, size, "white", edgecolor=INK, zorder=3)
    middle = x + (0.8 if both else 0.0) * size
    wide = (0.8 if both else 1.6) * size * min(max(opening, -1.0), 1.0)
    colour = AFTER if opening > 0 else HOSE
    box(axes, middle, y + 0.2 * size, wide, 0.6 * size, colour, zorder=4)
    axes.plot([middle, middle], [y, y + size], color=INK, linewidth=0.8, zorder=5)
