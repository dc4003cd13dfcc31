"""A two-joint robot of four muscles: its dynamics, kinematics, trajectories and identification."""

from jaxmuscle.robot.arm import Arm, RigidLink, rod
from jaxmuscle.robot.feedforward import pressure_commands, robot_coefficients
from jaxmuscle.robot.identification import Identified, SecondOrder, identify
from jaxmuscle.robot.kinematics import angles_at, elbow_point, inverse, jacobian, tip
from jaxmuscle.robot.pane import Pane
from jaxmuscle.robot.profile import Trapezoid
from jaxmuscle.robot.reference import robot, robot_joint
from jaxmuscle.robot.scara import Scara
from jaxmuscle.robot.trajectory import Motion, Straight, joint_motion, joints_along, line

__all__ = [
    "Arm",
    "Identified",
    "Motion",
    "Pane",
    "RigidLink",
    "Scara",
    "SecondOrder",
    "Straight",
    "Trapezoid",
    "angles_at",
    "elbow_point",
    "identify",
    "inverse",
    "jacobian",
    "joint_motion",
    "joints_along",
    "line",
    "pressure_commands",
    "robot",
    "robot_coefficients",
    "robot_joint",
    "rod",
    "tip",
]
