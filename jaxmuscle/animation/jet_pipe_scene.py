"""Scene of a jet-pipe valve and the cylinder that it feeds, the piston held or free to slide."""

from __future__ import annotations

from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon, Rectangle

from jaxmuscle.actuators import JetPipeActuator, JetPipePiston
from jaxmuscle.animation.drawn_parts import CELL, GROUND, HOSE, METAL, arrow, box, note, text, two_way_bar
from jaxmuscle.animation.muscle_shape import pressure_colour
from jaxmuscle.animation.scenes import Moment, Scene, scene
from jaxmuscle.components.jet_pipe_valve import FLANGE, SIDES
from jaxmuscle.figure_style import AFTER, INK, MUTED
from jaxmuscle.formatting import quantity

TIP, PRESSURES = "pipe_2", ("pressure_1", "pressure_2")
"""Entry of the state of the pipe that is the tip's position; pressures in the chambers."""
PORT = 0.085
"""Diameter of a port as it is drawn, as a part of the cylinder's length."""
COILS = 6
"""Coils of the spring."""


@scene.register
def jet_pipe_scene(actuator: JetPipeActuator | JetPipePiston) -> Scene:
    """The pipe swings over two ports, enlarged; each feeds one side of the piston, whose rod pulls a sensor.

    Port 1, to which a positive tip moves, is on the left, as chamber 1 is.
    """
    length, across = float(actuator.cylinder.free_length), float(actuator.cylinder.diameter)
    held = float(actuator.stopper_position) - float(actuator.cylinder.stopper_length)
    slides = isinstance(actuator, JetPipePiston)
    strongest = float(actuator.cylinder.piston_area * actuator.receiver.supply_pressure)
    larger = PORT * length / float(actuator.receiver.port_diameter)

    def draw(axes: Axes, now: Moment, level: Mapping[str, float]) -> None:
        travel = now["position"] if slides else held
        _draw_valve(axes, actuator, now, larger)
        _draw_cylinder(axes, length, across, travel, held, level)
        if slides:
            _draw_spring(axes, length, across, travel, held)
        _draw_sensor(axes, length, now.get("force"), strongest)
        for i, (x, side) in enumerate(((0.0, "left"), (1.05 * length, "right"))):
            told = f"chamber {i + 1}\n{quantity(now[PRESSURES[i]], 'Pa', 3)}"
            text(axes, x, -0.5 * across - 0.1 * length, told, ha=side)
        note(axes, f"the valve is drawn {larger:.2g} times as large")

    port = float(actuator.receiver.port_diameter)
    labels = (
        (0.52 * length, -0.5 * across - 0.05 * length, f"bore {quantity(across, 'm', 3)}"),
        (0.52 * length, -0.5 * across - 0.13 * length, f"length {quantity(length, 'm', 3)}"),
        (-0.33 * length, -0.5 * across - 0.1 * length, "force\nsensor"),
        (0.03 * length, 0.45 * length, f"ports {quantity(port, 'm', 3)}"),
        (0.3 * length, 0.75 * length, "jet pipe"),
    )
    pressure = float(actuator.initial_pressure)
    rest = {TIP: 0.0, "current": 0.0, **dict.fromkeys(PRESSURES, pressure)}
    limits = ((-0.5 * length, 1.2 * length), (-0.45 * length, 1.25 * length))
    needed = (TIP, *PRESSURES)
    if slides:
        rest |= {"position": 0.0, "supply_pressure": float(actuator.receiver.supply_pressure)}
        needed = ("position", *needed)
    return Scene("force", needed, rest, limits, draw, labels, {TIP: "position of the tip"})


def _draw_valve(axes: Axes, actuator: JetPipeActuator | JetPipePiston, now: Moment, larger: float) -> None:
    """Pipe, coil and receiver; what is `larger` times its size is drawn so."""
    length, across = float(actuator.cylinder.free_length), float(actuator.cylinder.diameter)
    middle, plate, high = 0.52 * length, 0.42 * length, 0.06 * length
    port = PORT * length
    box(axes, middle - 0.26 * length, plate, 0.52 * length, high, METAL, edgecolor=INK, zorder=3)
    for side, end in zip(SIDES, (0.04 * length, length), strict=True):
        x = middle - side * port
        box(axes, x - 0.5 * port, plate, port, high, "white", edgecolor=INK, linewidth=0.6, zorder=4)
        half = 0.5 * (plate + 0.5 * across)
        axes.plot([x, x, end, end], [plate, half, half, 0.5 * across], color=HOSE, linewidth=3, zorder=1.5)
    # A positive tip moves to port 1, on the left.
    tip = middle - larger * float(actuator.pipe.over_receiver(jnp.asarray(now[TIP])))
    top, gap = plate + high + 0.5 * length, plate + high + 0.015 * length
    edge = [(middle - 0.045 * length, top), (middle + 0.045 * length, top),
            (tip + 0.5 * port, gap), (tip - 0.5 * port, gap)]  # fmt: skip
    axes.add_patch(Polygon(edge, closed=True, facecolor="#dfe3e8", edgecolor=INK, linewidth=0.9, zorder=5))
    for begin in (tip - 0.5 * FLANGE * port, tip + 0.5 * port):
        box(axes, begin, gap, 0.5 * (FLANGE - 1) * port, 0.025 * length, GROUND, zorder=5.5)
    axes.plot([middle, middle], [top, top + 0.1 * length], color=HOSE, linewidth=3, zorder=1.5)
    supply = now.get("supply_pressure", float(actuator.receiver.supply_pressure))
    text(axes, middle, top + 0.14 * length, f"supply {quantity(supply, 'Pa', 3)}")
    current = now.get("current", 0.0)
    pull = float(actuator.pipe.tip_force(jnp.asarray(current)) / actuator.pipe.saturation_force)
    x, y = middle + 0.14 * length, top - 0.18 * length
    # Pulls to the left where the current is positive.
    two_way_bar(axes, x, y, 0.2 * length, 0.09 * length, -pull)
    text(axes, x + 0.1 * length, y - 0.06 * length, f"coil {quantity(current, 'A', 3)}")
    axes.plot([middle, x], [y + 0.045 * length] * 2, color=INK, linewidth=1.2, zorder=4)


def _draw_cylinder(
    axes: Axes, length: float, across: float, travel: float, held: float, level: Mapping[str, float]
) -> None:
    """Chambers in the colour of their pressures, piston, rod, and the stopper on the rod."""
    low, thick = -0.5 * across, 0.05 * length
    ends = ((0.0, travel), (travel + thick, length + thick))
    for name, (begin, end) in zip(PRESSURES, ends, strict=True):
        axes.add_patch(Rectangle((begin, low), max(end - begin, 0.0), across, zorder=2,
                                 facecolor=pressure_colour(level[name])))  # fmt: skip
    box(axes, 0.0, low, length + thick, across, "none", edgecolor=INK, linewidth=1.4, zorder=5)
    box(axes, travel, low, thick, across, METAL, edgecolor=INK, zorder=4)
    box(axes, held + thick, 0.5 * low, 0.025 * length, 0.5 * across, GROUND, zorder=4)
    box(axes, -0.28 * length, -0.05 * across, held + thick + 0.28 * length, 0.1 * across, GROUND, zorder=3)


def _draw_spring(axes: Axes, length: float, across: float, travel: float, held: float) -> None:
    """The spring between piston and stopper."""
    begin, end = travel + 0.05 * length, held + 0.05 * length
    steps = np.linspace(begin, max(end, begin), 2 * COILS + 1)
    heights = 0.3 * across * np.where(np.arange(2 * COILS + 1) % 2 == 0, 1, -1)
    axes.plot(steps, heights, color=MUTED, linewidth=1.2, zorder=3.5)


def _draw_sensor(axes: Axes, length: float, force: float | None, strongest: float) -> None:
    """The force sensor on its wall, and the pull that it shows."""
    box(axes, -0.4 * length, -0.14 * length, 0.05 * length, 0.28 * length, GROUND)
    box(axes, -0.35 * length, -0.06 * length, 0.08 * length, 0.12 * length, CELL)
    if force is not None:
        arrow(axes, -0.27 * length, 0.1 * length, 0.24 * length * min(force / strongest, 1.0), 0.02 * length)
        text(axes, -0.27 * length, 0.19 * length, quantity(force, "N", 3), ha="left", color=AFTER)
