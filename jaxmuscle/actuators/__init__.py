"""Whole machines. A new rig is a class here and a line in `RIGS`; a user's own is a class and `register`."""

from jaxmuscle.actuators.base import AbstractActuator, Held
from jaxmuscle.actuators.channel import Actuation, ControlChannel
from jaxmuscle.actuators.driven import Driven
from jaxmuscle.actuators.elbow import Elbow
from jaxmuscle.actuators.isotonic import Isotonic
from jaxmuscle.actuators.jetpipe import JetPipeActuator
from jaxmuscle.actuators.jetpipe_piston import JetPipePiston
from jaxmuscle.actuators.joint import Joint
from jaxmuscle.actuators.registry import RIGS, register, rig_named
from jaxmuscle.actuators.variables import Column, Command, Link, Reading, StateVariable

__all__ = [
    "RIGS",
    "AbstractActuator",
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
