"""SCARA arm: two links in a plane, each joint turned by two muscles, and a fixed pane that the tip leans
on.
"""

from __future__ import annotations

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.lax import optimization_barrier
from jaxtyping import Array, ArrayLike, Float

from jaxmuscle.actuators import Actuation, register
from jaxmuscle.actuators.actuator import Held, State
from jaxmuscle.actuators.joint import AbstractMuscleJoints, muscle_joints
from jaxmuscle.components import McKibben, PressureRegulator
from jaxmuscle.components.cylinder import at_stops, pressing, tension
from jaxmuscle.effects.base import AbstractEffect, States
from jaxmuscle.effects.chain import state_rates
from jaxmuscle.effects.contacts import bristle, slips, with_contacts
from jaxmuscle.effects.slip import friction_limit
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.robot.arm import Arm, between_stops, coupled_slip, stop_torque
from jaxmuscle.robot.kinematics import jacobian, tip
from jaxmuscle.signals import LOAD, MUSCLE_FORCE, Signals

Point = Float[Array, "... 2"]


class Pane(eqx.Module):
    r"""Unilateral spring and damper without friction: the foam roller against the window of [T].

    .. math:: F = K\,(δ)_+\,(1 + c\,\dot δ)_+

    along the pane's normal (Hunt and Crossley, J. Appl. Mech. 42, 1975), δ the penetration. Both positive
    parts are rounded over a small width by a parabola, so that F is continuous with its slope, exactly zero
    beyond that width, and never pulls. At stiffness 0 there is no pane.
    """

    stiffness: Scalar = parameter("N/m", "stiffness of roller and pane", default=0.0, nonnegative=True)
    damping: Scalar = parameter("s/m", "damping c of roller and pane", default=0.0, nonnegative=True)
    normal: Scalar = parameter("rad", "direction of the normal, pointing into the pane", default=0.0)
    distance: Scalar = parameter("m", "distance of the pane from the base along its normal", default=1.0)
    width: Scalar = parameter("m", "penetration over which contact sets in", default=1e-4, positive=True)

    def penetration(self, point: Point) -> Float[Array, "..."]:
        """Depth of a point behind the pane [m], negative in front of it."""
        return point @ self._direction - self.distance

    def force(self, point: Point, velocity: Point) -> Point:
        """Force of the pane on the tip [N], along the normal and away from the pane; SI."""
        return -self.pressing(point, velocity)[..., None] * self._direction

    def pressing(self, point: Point, velocity: Point) -> Float[Array, "..."]:
        """Size F of the contact force [N], never negative."""
        speed = velocity @ self._direction
        return pressing(self.penetration(point), speed, self.stiffness, self.damping, self.width)

    @property
    def _direction(self) -> Float[Array, "2"]:
        return jnp.stack([jnp.cos(self.normal), jnp.sin(self.normal)])


PULLS = np.array([[1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1.0]])
"""The sense in which each of the four muscles turns each of the two joints."""


@register
class Scara(AbstractMuscleJoints):
    r"""Rig `scara`: commands → regulated pressures → muscle forces → joint torques → motion of the arm.

    .. math:: M(q)\,\ddot q + h(q, \dot q) = R\,S F + J^T F_{pane}, \quad x = ε_0 l_0 + R\,S^T q,
              \quad x, F ≥ 0

    [T], robot section; S is :data:`PULLS`. A positive angle shortens the first muscle of its joint. Each
    joint ends at ±ε0 l0/R, where a muscle is at its full length; the stop is inelastic and resists with the
    torque that keeps the joint there whatever the other one does. Arrays run over the four muscles (two of
    joint 1, two of joint 2) or over the two joints.
    """

    rig: ClassVar = "scara"
    quantities: ClassVar = {
        **AbstractMuscleJoints.quantities,
        "first_length": "arm.first.length",
        "first_mass": "arm.first.mass",
        "first_centre": "arm.first.centre",
        "first_inertia": "arm.first.inertia",
        "second_length": "arm.second.length",
        "second_mass": "arm.second.mass",
        "second_centre": "arm.second.centre",
        "second_inertia": "arm.second.inertia",
        "payload": "arm.payload",
        "gravity": "arm.gravity",
        "pane_stiffness": "pane.stiffness",
        "pane_damping": "pane.damping",
        "pane_normal": "pane.normal",
        "pane_distance": "pane.distance",
        "pane_width": "pane.width",
    }
    variables: ClassVar = muscle_joints(
        ("command_1", "command_2", "command_3", "command_4"),
        ("pressure_1", "pressure_2", "pressure_3", "pressure_4"),
        ("angle_1", "angle_2"),
    )
    instead_of_a_channel: ClassVar = "; of several joints: control.independent_joints"
    available: ClassVar = frozenset(
        "command past time neutral spool pressure muscle contraction contraction_velocity position velocity "
        "slip sprocket".split()
    )

    regulator: PressureRegulator
    muscle: McKibben
    arm: Arm
    sprocket_radius: Scalar = parameter("m", "radius of the sprockets", positive=True)
    initial_contraction: Scalar = parameter("", "contraction ratio of all muscles at angle 0")
    pane: Pane = eqx.field(default_factory=Pane)
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def joint_actuation(self, mean_pressure: ArrayLike = 2.5e5) -> Actuation:
        """Commands P0 ± ΔU of each joint's two muscles, between no pressure and twice the mean one ([T]).

        Its direction has a row for each joint. `mean_pressure`: P0, gauge [Pa].
        """
        ambient, mean, side = self.ambient_pressure, jnp.asarray(mean_pressure, dtype=float), jnp.ones(4)
        rest, highest = (ambient + mean) * side, (ambient + 2 * mean) * side
        return Actuation(rest, jnp.asarray(PULLS), ambient * side, highest)

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = self._up_to_the_muscles(state, held, states, PULLS)
        loose = self._load(signals, signals.muscle_force, states)
        signals = with_contacts(self.effects, signals, self._dry_limits)
        of_all_threads, in_bearing = self._dry_limits(signals)
        limit = of_all_threads + in_bearing
        # A barrier: else XLA computes what leads to a torque once for each of its many uses.
        driving = optimization_barrier(loose.load - self.arm.bias(loose.position, loose.velocity))
        mass = self.arm.mass_matrix(loose.position)
        stops = at_stops(loose.position, *self._ends)
        built_up = bristle(self.effects, states, signals)
        slip = coupled_slip(driving, loose.velocity, limit, mass, held.widening, stops, built_up)
        of_threads, of_bearing = slips(slip, built_up)
        in_threads = self._in_threads(signals)
        rubbed = self._load(signals, signals.muscle_force - in_threads * (of_threads @ PULLS), states)
        return rubbed.having(load=rubbed.load - in_bearing * of_bearing)

    def _in_threads(self, signals: Signals) -> Array:
        """Limit of the dry friction in the threads of each muscle [N]."""
        return friction_limit(self.effects, MUSCLE_FORCE, signals) * jnp.ones(4)

    def _dry_limits(self, signals: Signals) -> tuple[Array, Array]:
        """Limits of dry friction of the threads and of the bearing at each joint [N m]."""
        of_threads = self._torque(self._in_threads(signals) * PULLS, signals.position, PULLS)
        return of_threads, friction_limit(self.effects, LOAD, signals) * jnp.ones(2)

    def _load(self, signals: Signals, muscle_force: Array, states: States) -> Signals:
        """The chain from the muscle forces, which cannot push, to the torques at the joints."""
        pulling = signals.having(muscle_force=tension(muscle_force))
        torque = self._torque(pulling.muscle_force, signals.position, PULLS)
        torque = torque + self.contact_torque(signals.position, signals.velocity)
        return self._with(pulling, LOAD, torque, states)

    def contact_torque(self, angle: Array, velocity: Array) -> Array:
        """Torques at the joints by which the pane pushes the tip back, J' F [N m]."""
        turning = jacobian(self.arm, angle)
        return self.pane.force(tip(self.arm, angle), turning @ velocity) @ turning

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {
            **self._pressure_rates(state, signals),
            "angle": signals.velocity,
            "angular_velocity": self._acceleration(signals),
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }

    def _acceleration(self, signals: Signals) -> Array:
        """Angular accelerations, none into an end that has been reached [rad/s^2]."""
        angle, velocity = signals.position, signals.velocity
        load = optimization_barrier(signals.load)
        torque = load - self.arm.bias(angle, velocity)
        resisting = stop_torque(torque, at_stops(angle, *self._ends), self.arm.mass_matrix(angle))
        free = self.arm.acceleration(angle, velocity, load - resisting)
        # Exactly none: what rounding leaves would lift the joint off its end and let it knock.
        return jnp.where(resisting != 0, 0.0, free)

    def constrained(self, state: State) -> State:
        lowest, highest = self._ends
        within = jnp.clip(state["angle"], lowest, highest)
        angle, velocity = between_stops(
            state["angle"], state["angular_velocity"], lowest, highest, self.arm.mass_matrix(within)
        )
        return {**state, "angle": angle, "angular_velocity": velocity}
