"""Whole machines. A new rig is a class here and a line in `RIGS`."""

from jaxmuscle.actuators.base import AbstractActuator, Held, Link
from jaxmuscle.actuators.driven import Driven
from jaxmuscle.actuators.isotonic import Isotonic
from jaxmuscle.actuators.joint import Joint

RIGS: dict[str, type[AbstractActuator]] = {rig.rig: rig for rig in (Isotonic, Driven, Joint)}

__all__ = ["RIGS", "AbstractActuator", "Driven", "Held", "Isotonic", "Joint", "Link"]
