"""Sampled controllers, pure functions (state, reference, measurement) → (state, command), and the loop that
closes them over a machine.
"""

from jaxmuscle.control.channel_model import ChannelModel, channel_model
from jaxmuscle.control.command_knots import CommandKnots, command_knots
from jaxmuscle.control.digital import DigitalController
from jaxmuscle.control.feedback import Attached, feedback_on
from jaxmuscle.control.feedforward import FeedForward
from jaxmuscle.control.force import ProportionalForce, StaticCurve
from jaxmuscle.control.fuzzy import MACVICAR_WHELAN, FuzzyPID
from jaxmuscle.control.independent_joints import IndependentJoints, independent_joints
from jaxmuscle.control.iterative_learning import (
    InverseLearning,
    Learned,
    ProportionalLearning,
    contraction,
    inverse_learning,
    learn,
    repeated,
)
from jaxmuscle.control.linear_quadratic import LinearQuadratic, linear_quadratic
from jaxmuscle.control.loop import ClosedLoop, Controller, closed_loop
from jaxmuscle.control.model_inverse import ModelInverse, model_inverse
from jaxmuscle.control.model_predictive import ModelPredictive, model_predictive
from jaxmuscle.control.pid import PID, IntegralInversePID, ScheduledPID
from jaxmuscle.control.simulated_inverse import SimulatedInverse, simulated_inverse
from jaxmuscle.control.sliding_mode import JointModel, Reference, SlidingMode, joint_model
from jaxmuscle.control.stability_margins import Margins, margins

__all__ = [
    "MACVICAR_WHELAN",
    "PID",
    "Attached",
    "ChannelModel",
    "ClosedLoop",
    "CommandKnots",
    "Controller",
    "DigitalController",
    "FeedForward",
    "FuzzyPID",
    "IndependentJoints",
    "IntegralInversePID",
    "InverseLearning",
    "JointModel",
    "Learned",
    "LinearQuadratic",
    "Margins",
    "ModelInverse",
    "ModelPredictive",
    "ProportionalForce",
    "ProportionalLearning",
    "Reference",
    "ScheduledPID",
    "SimulatedInverse",
    "SlidingMode",
    "StaticCurve",
    "channel_model",
    "closed_loop",
    "command_knots",
    "contraction",
    "feedback_on",
    "independent_joints",
    "inverse_learning",
    "joint_model",
    "learn",
    "linear_quadratic",
    "margins",
    "model_inverse",
    "model_predictive",
    "repeated",
    "simulated_inverse",
]
