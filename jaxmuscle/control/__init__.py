"""Sampled controllers: pure functions (state, reference, measurement) → (state, command)."""

from jaxmuscle.control.proportional import ProportionalForce, StaticCurve
from jaxmuscle.control.scheduled import ScheduledPID
from jaxmuscle.control.sliding import Reference, SecondOrder, SlidingMode

__all__ = ["ProportionalForce", "Reference", "ScheduledPID", "SecondOrder", "SlidingMode", "StaticCurve"]
