"""Sampled controllers, pure functions (state, reference, measurement) → (state, command), and the loop that
closes them over a machine.
"""

from jaxmuscle.control.feedback import Attached, feedback_on
from jaxmuscle.control.feedforward import FeedForward
from jaxmuscle.control.force import ProportionalForce, StaticCurve
from jaxmuscle.control.fuzzy import MACVICAR_WHELAN, FuzzyPID
from jaxmuscle.control.linear_quadratic import LinearQuadratic, linear_quadratic
from jaxmuscle.control.loop import ClosedLoop, Controller, closed_loop
from jaxmuscle.control.model_inverse import ModelInverse, model_inverse
from jaxmuscle.control.pid import PID, IntegralInversePID, ScheduledPID
from jaxmuscle.control.sliding_mode import JointModel, Reference, SlidingMode, joint_model

__all__ = [
    "MACVICAR_WHELAN",
    "PID",
    "Attached",
    "ClosedLoop",
    "Controller",
    "FeedForward",
    "FuzzyPID",
    "IntegralInversePID",
    "JointModel",
    "LinearQuadratic",
    "ModelInverse",
    "ProportionalForce",
    "Reference",
    "ScheduledPID",
    "SlidingMode",
    "StaticCurve",
    "closed_loop",
    "feedback_on",
    "joint_model",
    "linear_quadratic",
    "model_inverse",
]
