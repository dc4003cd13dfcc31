"""Whole machines. A new rig is a class here and a line in `RIGS`."""

from jaxmuscle.actuators.base import AbstractActuator, Held, Link
from jaxmuscle.actuators.driven import Driven
from jaxmuscle.actuators.elbow import Elbow
from jaxmuscle.actuators.isotonic import Isotonic
from jaxmuscle.actuators.jetpipe import JetPipeActuator
from jaxmuscle.actuators.joint import Joint

RIGS: dict[str, type[AbstractActuator]] = {
    rig.rig: rig for rig in (Isotonic, Driven, Joint, JetPipeActuator, Elbow)
}

__all__ = [
    "RIGS",
    "AbstractActuator",
    "Driven",
    "Elbow",
    "Held",
    "Isotonic",
    "JetPipeActuator",
    "Joint",
    "Link",
]
