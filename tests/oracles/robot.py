"""The two-joint robot in MuJoCo, which knows its masses and its pane's Jacobian; muscles in plain NumPy.

Pressures are those of a second-order lag with constant commands, in closed form; the muscles' torques and
the pane's force are worked out afresh at every stage of MuJoCo's Runge-Kutta steps.
"""

# pyright: reportAttributeAccessIssue=false
from math import cos, exp, pi, sin, sqrt

import mujoco
import numpy as np
from oracles.muscle import schulte_force, thread_limit

XML = """
<mujoco>
  <compiler angle="radian" inertiafromgeom="false" balanceinertia="false"/>
  <option integrator="RK4" timestep="{step}" gravity="0 {gravity} 0"/>
  <worldbody>
    <body name="first">
      <joint name="q1" type="hinge" axis="0 0 1"/>
      <inertial pos="{c1} 0 0" mass="{m1}" diaginertia="{i1} {i1} {i1}"/>
      <body name="second" pos="{l1} 0 0">
        <joint name="q2" type="hinge" axis="0 0 1"/>
        <inertial pos="{c2} 0 0" mass="{m2}" diaginertia="{i2} {i2} {i2}"/>
        <site name="tip" pos="{l2} 0 0"/>
        {payload}
      </body>
    </body>
  </worldbody>
</mujoco>
"""
PAYLOAD = """<body name="payload" pos="{l2} 0 0">
  <inertial pos="0 0 0" mass="{payload}" diaginertia="1e-13 1e-13 1e-13"/></body>"""


def model(card, step=1e-4):
    """MuJoCo's model of the arm of a card."""
    payload = PAYLOAD.format(**card) if card["payload"] else ""
    names = ("l1", "m1", "c1", "i1", "l2", "m2", "c2", "i2")
    values = {name: card[name] for name in names}
    return mujoco.MjModel.from_xml_string(
        XML.format(step=step, gravity=-card["gravity"], **{**values, "payload": payload})
    )


def acceleration(card, angle, velocity, torque):
    """Joint accelerations of the bare arm under given torques."""
    arm = model(card)
    data = mujoco.MjData(arm)
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = angle, velocity, torque
    mujoco.mj_forward(arm, data)
    return data.qacc.copy()


def tip(card, angle):
    """Position of the tip and its Jacobian."""
    arm = model(card)
    data = mujoco.MjData(arm)
    data.qpos[:] = angle
    mujoco.mj_forward(arm, data)
    return data.site("tip").xpos[:2].copy(), _jacobian(arm, data)


def run(card, first, then, angle, samples, every, step):
    """Angles and velocities at every so many steps, from rest; gauge pressures go from `first` to `then`."""
    arm = model(card, step)
    data = mujoco.MjData(arm)
    data.qpos[:] = angle
    omega, zeta = 2 * pi * card["regulator_frequency"], card["regulator_damping"]

    def pressures(t):
        fast = omega * sqrt(1 - zeta**2)
        left = exp(-zeta * omega * t) * (cos(fast * t) + zeta * omega / fast * sin(fast * t))
        return np.asarray(then) + (np.asarray(first) - np.asarray(then)) * left

    def torques(_, data):
        p, q, w = pressures(data.time), data.qpos, data.qvel
        for joint in (0, 1):
            data.qfrc_passive[joint] = joint_torque(card, p[2 * joint : 2 * joint + 2], q[joint], w[joint])
        if card["pane_stiffness"]:
            data.qfrc_passive[:] += _jacobian(arm, data).T @ _pane(card, arm, data)

    rows = []
    mujoco.set_mjcb_passive(torques)
    try:
        for _ in range(samples):
            rows.append(np.concatenate([data.qpos, data.qvel]))
            for _ in range(every):
                mujoco.mj_step(arm, data)
    finally:
        mujoco.set_mjcb_passive(None)
    return np.array(rows)


CREEP = 2e-5
"""Contraction velocity over which the friction of the threads turns over [m/s]."""


def joint_torque(card, pressure, angle, velocity):
    """Torque of two muscles that cannot push, with thread friction against the motion."""
    total = 0.0
    for side, p in zip((1.0, -1.0), pressure, strict=True):
        strain = card["initial_contraction"] + side * card["sprocket_radius"] * angle / card["initial_length"]
        speed = side * card["sprocket_radius"] * velocity
        force = schulte_force(card, strain, p, card["end_factor"])
        force -= np.tanh(speed / CREEP) * thread_limit(card, card["effects"], strain, p, speed)
        total += side * card["sprocket_radius"] * max(force, 0.0)
    return total


def contact_torque(card, angle, velocity):
    """Torques of the pane at the joints."""
    arm = model(card)
    data = mujoco.MjData(arm)
    data.qpos[:], data.qvel[:] = angle, velocity
    mujoco.mj_forward(arm, data)
    return _jacobian(arm, data).T @ _pane(card, arm, data)


def _pane(card, arm, data):
    """Hunt-Crossley force on the tip."""
    normal = np.array([cos(card["pane_normal"]), sin(card["pane_normal"])])
    depth = data.site("tip").xpos[:2] @ normal - card["pane_distance"]
    speed = (_jacobian(arm, data) @ data.qvel) @ normal
    spring = card["pane_stiffness"] * _rounded(depth, card["pane_width"])
    return -normal * spring * _rounded(1 + card["pane_damping"] * speed, 0.1)


def _rounded(value, width):
    """max(value, 0), a parabola within the width of the corner."""
    if abs(value) < width:
        return (value + width) ** 2 / (4 * width)
    return max(value, 0.0)


def _jacobian(arm, data):
    turning = np.zeros((3, 2))
    mujoco.mj_jacSite(arm, data, turning, None, data.site("tip").id)
    return turning[:2]
