"""A two-joint robot of four muscles: its dynamics, kinematics, trajectories and identification."""

from jaxmuscle.robot.arm import Arm, RigidLink, rod
from jaxmuscle.robot.kinematics import angles_at, elbow_point, inverse, jacobian, tip
from jaxmuscle.robot.scara import Pane, Scara
from jaxmuscle.robot.second_order import Identified, SecondOrder, identify
from jaxmuscle.robot.tondu2000 import pressure_commands, robot, robot_coefficients, robot_joint
from jaxmuscle.robot.trajectory import Motion, Straight, Trapezoid, joint_motion, joints_along, line

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
