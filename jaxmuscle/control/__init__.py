"""Sampled controllers: pure functions (state, reference, measurement) → (state, command)."""

from jaxmuscle.control.scheduled import ScheduledPID
from jaxmuscle.control.sliding import Reference, SecondOrder, SlidingMode

__all__ = ["Reference", "ScheduledPID", "SecondOrder", "SlidingMode"]
