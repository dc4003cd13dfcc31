"""Two muscles that pull against each other on a sprocket, as they are drawn: on a wall or along a link."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax.numpy as jnp
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle
from numpy.typing import NDArray

from jaxmuscle.actuators.joint import SIDES, AbstractPulledJoints
from jaxmuscle.animation.drawn_parts import METAL
from jaxmuscle.animation.muscle_shape import draw_muscle, radius_at
from jaxmuscle.components.mckibben import largest_contraction
from jaxmuscle.effects.transmission import shortening
from jaxmuscle.figure_style import INK
from jaxmuscle.formatting import quantity

Point = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class OpposedMuscles:
    """Geometry of the two muscles of a joint, in a frame whose origin is the joint, muscles at negative x.

    Attributes:
        thickness: how many times as thick as they are the muscles are drawn.
    """

    actuator: AbstractPulledJoints
    thickness: float = 1.0

    @property
    def length(self) -> float:
        """Length l0 of a muscle [m]."""
        return float(self.actuator.muscle.initial_length)

    @property
    def sprocket(self) -> float:
        """Radius R [m]."""
        return float(self.actuator.sprocket_radius)

    @property
    def widest(self) -> float:
        """Radius of a muscle at its largest contraction, as drawn [m]."""
        muscle = self.actuator.muscle
        return self.thickness * radius_at(muscle, float(largest_contraction(muscle)))

    @property
    def apart(self) -> Point:
        """Distance of either muscle's axis from that of the joint [m]."""
        return SIDES * max(self.sprocket, 1.3 * self.widest)

    @property
    def begin(self) -> float:
        """Place of the fixed ends, below zero [m]."""
        return -(1.05 * self.length + 2.5 * self.sprocket)

    def ends(self, angle: float) -> Point:
        r"""Places of the ends that move [m]: :math:`x = ε_0 l_0 ± R θ` from where a long muscle ends."""
        wound = np.asarray(shortening(self.actuator.effects, jnp.asarray(angle), SIDES))
        middle = float(self.actuator.initial_contraction) * self.length
        return self.begin + self.length - middle - self.sprocket * wound

    def draw(
        self, axes: Axes, angle: float, levels: tuple[float, float],
        centre: Point | None = None, turned: float = 0.0,
    ) -> None:  # fmt: skip
        """Muscles, chain and sprocket at an angle of the joint [rad].

        Args:
            levels: pressures as parts of the highest one.
            centre, turned: place of the joint [m], and the angle of what carries the muscles [rad].
        """
        origin = np.zeros(2) if centre is None else centre
        turn = np.array([[np.cos(turned), -np.sin(turned)], [np.sin(turned), np.cos(turned)]])
        place = lambda x, y: origin + turn @ np.array([x, y])  # noqa: E731
        for side, apart, reached, level in zip(SIDES, self.apart, self.ends(angle), levels, strict=True):
            end, around = place(reached, apart), place(0.0, self.sprocket * side)
            axes.plot([end[0], around[0]], [end[1], around[1]], color=INK, linewidth=1.6, zorder=2)
            muscle, begin = self.actuator.muscle, place(self.begin, apart)
            draw_muscle(axes, muscle, begin, end, level, self.thickness)
        x, y = origin
        axes.add_patch(Circle((x, y), self.sprocket, facecolor=METAL, edgecolor=INK, zorder=4))

    def dimensions(self) -> str:
        """Length, radius and braid angle of the muscles."""
        muscle = self.actuator.muscle
        return (
            f"l₀ = {quantity(self.length, 'm', 3)}    "
            f"r₀ = {quantity(float(muscle.initial_radius), 'm', 3)}    "
            f"α₀ = {quantity(float(muscle.braid_angle), 'rad', 3)}"
        )


def levels_of(level: Mapping[str, float], first: int) -> tuple[float, float]:
    """Levels of the pressures in muscle `first` and the next one."""
    return level[f"pressure_{first}"], level[f"pressure_{first + 1}"]
