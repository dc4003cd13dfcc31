"""Actuator models. A new rig is a class here and a line in `RIGS`; a user's own is a class and `register`."""

from __future__ import annotations

import inspect
from typing import TypeVar

from jaxmuscle.actuators.actuator import OLDER, AbstractActuator, Held
from jaxmuscle.actuators.control_channel import Actuation, ControlChannel
from jaxmuscle.actuators.driven import Driven
from jaxmuscle.actuators.elbow import Elbow
from jaxmuscle.actuators.imposed import AbstractImposed
from jaxmuscle.actuators.isotonic import Isotonic
from jaxmuscle.actuators.jet_pipe import JetPipeActuator, JetPipePiston
from jaxmuscle.actuators.joint import Joint
from jaxmuscle.actuators.variables import Column, Command, Link, Reading, StateVariable
from jaxmuscle.errors import InputError, nearest_or_own

__all__ = [
    "RIGS",
    "AbstractActuator",
    "AbstractImposed",
    "Actuation",
    "Column",
    "Command",
    "ControlChannel",
    "Driven",
    "Elbow",
    "Held",
    "Isotonic",
    "JetPipeActuator",
    "JetPipePiston",
    "Joint",
    "Link",
    "Reading",
    "StateVariable",
    "register",
    "rig_named",
]


Rig = TypeVar("Rig", bound=type[AbstractActuator])

RIGS: dict[str, type[AbstractActuator]] = {
    rig.rig: rig for rig in (Isotonic, Driven, Joint, JetPipeActuator, JetPipePiston, Elbow)
}
"""Name, as cards use it → class. `Scara` joins them where :mod:`jaxmuscle.robot` defines it."""
DECLARED = ("rig", "units", "quantities", "available", "largest_step")
"""Class variables that a rig has to have beside `variables`; see :class:`AbstractActuator`."""


def rig_named(name: str) -> type[AbstractActuator]:
    """The class of a rig; `InputError` when no rig of that name is registered."""
    if name not in RIGS:
        raise InputError(f"unknown rig {name!r}{nearest_or_own(name, RIGS, 'jaxmuscle.actuators.register')}")
    return RIGS[name]


def register(rig: Rig) -> Rig:
    """Make a rig known by its name, so that cards can name it and fits of it can be saved and loaded.

    A class decorator. A fit in memory does not need it. Registering the same class again (a cell of a
    notebook that is run twice) replaces it.

    Raises:
        InputError: a class variable is missing, something is still abstract, or the name is taken.
    """
    missing = [name for name in DECLARED if not hasattr(rig, name)]
    missing += [] if all(hasattr(rig, name) for name in OLDER) else ["variables"]
    if missing:
        raise InputError(f"{rig.__name__}: expected class variables {', '.join(missing)}; they are missing")
    if inspect.isabstract(rig):
        raise InputError(
            f"{rig.__name__}: still abstract; define {', '.join(sorted(rig.__abstractmethods__))}"
        )
    taken = RIGS.get(rig.rig)
    if taken is not None and (taken.__module__, taken.__qualname__) != (rig.__module__, rig.__qualname__):
        raise InputError(f"{rig.__name__}: the name {rig.rig!r} is that of {taken.__name__}; choose another")
    RIGS[rig.rig] = rig
    return rig
