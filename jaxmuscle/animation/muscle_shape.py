"""Shape of a McKibben muscle as it is drawn: bladder and braid at their actual length and radius."""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from jaxmuscle.figure_style import INK

THREADS, POINTS = 7, 90
"""Threads of the braid in either sense that are drawn, and points along each."""
EMPTY, FULL = np.array([0.93, 0.90, 0.87]), np.array([0.85, 0.33, 0.12])
"""Colours of the bladder without pressure and at the highest one that is shown."""
Point = NDArray[np.float64]


def radius_at(muscle: Any, contraction: float) -> float:
    """Radius of the cylinder [m] of a :class:`~jaxmuscle.components.McKibben` muscle, or one by its thread.

    :math:`r = r_0 \\sqrt{1 - \\cos^2α_0 (l/l_0)^2}/\\sinα_0`, [T] equation 3; contraction in m.
    """
    length = float(muscle.initial_length)
    ratio = max(1 - contraction / length, 0.05)
    return float(muscle.initial_radius) * float(muscle.swelling(jnp.asarray(ratio)))


def turns(muscle: Any) -> float:
    """Turns of a thread around the muscle, :math:`n = l_0 \\tanα_0 / (2 π r_0)`, which stay as it swells."""
    angle = float(muscle.braid_angle)
    return float(muscle.initial_length) * math.tan(angle) / (2 * math.pi * float(muscle.initial_radius))


def profile(length: float, radius: float, ends: float) -> tuple[Point, Point]:
    """Places along a muscle and its radius there: a cylinder with ends rounded down to the fittings."""
    along = np.linspace(0.0, length, POINTS)
    cap = min(1.6 * radius, 0.25 * length)
    near = np.clip(np.minimum(along, length - along) / cap, 0.0, 1.0)
    return along, ends + (radius - ends) * np.sqrt(1 - (1 - near) ** 2)


def pressure_colour(level: float) -> tuple[float, float, float]:
    """Colour (red, green, blue) of a pressure, as a part of the highest one that is shown."""
    red, green, blue = EMPTY + (FULL - EMPTY) * min(max(level, 0.0), 1.0)
    return float(red), float(green), float(blue)


def draw_muscle(
    axes: Axes, muscle: Any, begin: Point, end: Point, level: float, thickness: float = 1.0
) -> None:
    """The muscle between two points [m], at the radius that belongs to their distance.

    Args:
        level: pressure as a part of the highest one that is shown.
        thickness: how many times as thick as it is the muscle is drawn.
    """
    length = float(np.linalg.norm(end - begin))
    radius = thickness * radius_at(muscle, float(muscle.initial_length) - length)
    ends = 0.6 * thickness * float(muscle.initial_radius)
    draw_bladder(axes, begin, end, radius, ends, turns(muscle), level)


def draw_bladder(
    axes: Axes, begin: Point, end: Point, radius: float, ends: float, windings: float, level: float
) -> None:
    """A bladder with its braid between two points: threads in front of it, in both senses."""
    length = float(np.linalg.norm(end - begin))
    axis = (end - begin) / length
    across = np.array([-axis[1], axis[0]])
    along, half = profile(length, radius, min(ends, radius))
    edge = np.concatenate([np.stack([along, half], 1), np.stack([along, -half], 1)[::-1]])
    place = lambda points: begin + points[:, :1] * axis + points[:, 1:] * across  # noqa: E731
    colour = pressure_colour(level)
    axes.add_patch(
        Polygon(place(edge), closed=True, facecolor=colour, edgecolor=INK, linewidth=0.9, zorder=3)
    )
    lines = []
    for sense in (1.0, -1.0):
        for thread in range(THREADS):
            angle = 2 * math.pi * (sense * windings * along / length + thread / THREADS)
            points = place(np.stack([along, half * np.sin(angle)], 1))
            front = np.cos(angle) > 0
            pieces = np.split(np.arange(len(along)), np.flatnonzero(np.diff(front.astype(int))) + 1)
            lines += [points[piece] for piece in pieces if front[piece[0]] and len(piece) > 1]
    axes.add_collection(LineCollection(lines, colors=INK, linewidths=0.45, alpha=0.7, zorder=3.5))
    high, long = 1.15 * min(ends, radius), 0.02 * length
    corners = np.array([[-long, -high], [long, -high], [long, high], [-long, high]])
    for centre in (begin, end):
        fitting = place(corners) - begin + centre
        axes.add_patch(Polygon(fitting, closed=True, facecolor="#4b5563", edgecolor="none", zorder=4))
