"""Equations of the parts of a machine: gas, valve, regulator, muscle. No states, no wiring."""

from jaxmuscle.components.gas import nozzle_flow
from jaxmuscle.components.muscle import McKibben
from jaxmuscle.components.regulator import PressureRegulator
from jaxmuscle.components.valve import FlowValve

__all__ = ["FlowValve", "McKibben", "PressureRegulator", "nozzle_flow"]
