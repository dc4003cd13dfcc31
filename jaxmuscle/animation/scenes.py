"""What is to be seen of a rig: the form of a scene, and which scene is that of which rig."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import singledispatch

from matplotlib.axes import Axes

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError

Moment = Mapping[str, float]
"""Column → its value (SI, pressures absolute); ``level`` of each pressure column is a part of the highest."""


@dataclasses.dataclass(frozen=True)
class Scene:
    """How a rig is drawn.

    Attributes:
        motion: column that moves it; other columns that are needed: `needed`. States that no sensor shows
            are there, numbered from 1 where they are arrays, if the run is a simulation that keeps them.
        rest: moment at which :func:`jaxmuscle.draw` shows it.
        limits: (left, right), (bottom, top) of what is to be seen [m].
        draw: puts the parts at a moment into axes; pressures are given as levels beside their columns,
            ``level(column)`` as a part of the highest.
        labels: place and text of each dimension.
        titles: what stands above the curve of a column, in the place of its name.
    """

    motion: str
    needed: tuple[str, ...]
    rest: Moment
    limits: tuple[tuple[float, float], tuple[float, float]]
    draw: Callable[[Axes, Moment, Mapping[str, float]], None]
    labels: tuple[tuple[float, float, str], ...] = ()
    titles: Mapping[str, str] = dataclasses.field(default_factory=dict)


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
