"""Equations of the parts of a machine: gas, valves, cylinder, muscle. No states, no wiring."""

from jaxmuscle.components.chamber import ChamberGas
from jaxmuscle.components.cylinder import Cylinder
from jaxmuscle.components.driver import CurrentDriver
from jaxmuscle.components.gas import nozzle_flow
from jaxmuscle.components.jetpipe import JetPipe
from jaxmuscle.components.muscle import McKibben
from jaxmuscle.components.overlap import circle_overlap
from jaxmuscle.components.piston import Piston
from jaxmuscle.components.receiver import Receiver
from jaxmuscle.components.regulator import PressureRegulator
from jaxmuscle.components.schulte import ThreadMuscle, described_by_thread
from jaxmuscle.components.valve import FlowValve

__all__ = [
    "ChamberGas",
    "CurrentDriver",
    "Cylinder",
    "FlowValve",
    "JetPipe",
    "McKibben",
    "Piston",
    "PressureRegulator",
    "Receiver",
    "ThreadMuscle",
    "circle_overlap",
    "described_by_thread",
    "nozzle_flow",
]
