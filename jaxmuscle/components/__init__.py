"""Equations of the parts of a machine: gas, valves, cylinder, muscle. No states, no wiring."""

from jaxmuscle.components.cylinder import Cylinder, Piston
from jaxmuscle.components.gas import ChamberGas, nozzle_flow
from jaxmuscle.components.jet_pipe_valve import JetPipe, Receiver, circle_overlap
from jaxmuscle.components.mckibben import McKibben, ThreadMuscle, described_by_thread
from jaxmuscle.components.valves import CurrentDriver, FlowValve, PressureRegulator

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
