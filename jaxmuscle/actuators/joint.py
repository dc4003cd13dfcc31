"""Joints that muscles pull on, pressure-regulated joints, and the antagonistic joint: two muscles pull a
sprocket against each other, each fed by a pressure regulator.
"""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike

from jaxmuscle.actuators.actuator import AbstractActuator, Held, State
from jaxmuscle.actuators.control_channel import Actuation, ControlChannel
from jaxmuscle.actuators.variables import Command, Reading, StateVariable, Variable
from jaxmuscle.components import McKibben, PressureRegulator
from jaxmuscle.components.antagonist import joint_range
from jaxmuscle.components.cylinder import stopped, stopped_acceleration, tension
from jaxmuscle.effects.base import AbstractEffect, States
from jaxmuscle.effects.chain import altered_muscle, state_rates
from jaxmuscle.effects.contacts import bristle, slips, with_contacts
from jaxmuscle.effects.slip import friction_limit, slip_of_mass
from jaxmuscle.effects.transmission import Pulls, arms, over_joints, shortening, unwound
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import COMMAND, LOAD, MUSCLE_FORCE, Signals

SIDES = np.array([1.0, -1.0])
"""The sense in which each of two muscles turns their joint."""


def joint_angles(angles: tuple[str, ...]) -> tuple[Variable, ...]:
    """Variables of joints that muscles turn: the columns of their angles, predicted from the pressures."""
    return (
        StateVariable("angle", "rad", angles, rate="angular_velocity", check="joint angle"),
        Reading("angle", given=("pressure",), signal="load"),
    )


class AbstractPulledJoints(AbstractActuator):
    """Equal muscles on sprockets of one radius; angles are measured.

    The braid does not stretch: a joint ends, inelastically, where one of its muscles is at its full length,
    x = 0 or θ = ±ε0 l0/R (:func:`jaxmuscle.components.antagonist.joint_range`).
    """

    quantities: ClassVar = {
        "initial_length": "muscle.initial_length",
        "initial_radius": "muscle.initial_radius",
        "braid_angle": "muscle.braid_angle",
        "end_factor": "muscle.end_factor",
        "sprocket_radius": "sprocket_radius",
        "initial_contraction": "initial_contraction",
        "ambient_pressure": "ambient_pressure",
    }
    largest_step: ClassVar = 0.002

    muscle: eqx.AbstractVar[McKibben]
    sprocket_radius: eqx.AbstractVar[Scalar]
    initial_contraction: eqx.AbstractVar[Scalar]
    ambient_pressure: eqx.AbstractVar[Scalar]

    def _up_to_the_muscles(self, state: State, held: Held, states: States, pulls: Pulls) -> Signals:
        """The chain up to the muscle forces.

        `pulls`: the sense in which each muscle turns each joint; for a single joint, its two muscles.
        """
        angle, velocity = state["angle"], state["angular_velocity"]
        middle = self.initial_contraction * self.muscle.initial_length
        muscle = altered_muscle(self.effects, self.muscle)
        signals = Signals(
            past=held.past,
            time=held.time,
            ambient_pressure=self.ambient_pressure,
            pressure=state["pressure"],
            muscle=muscle,
            contraction=middle + self.sprocket_radius * shortening(self.effects, angle, pulls),
            contraction_velocity=over_joints(
                (self.sprocket_radius * velocity)[..., None] * arms(self.effects, angle, pulls)
            ),
            position=angle,
            velocity=velocity,
        )
        if self.commands:
            signals = self._with(self._behind_valves(signals, state), COMMAND, held.command, states)
        force = muscle.force(signals.contraction, signals.gauge_pressure, muscle.end_factor)
        return self._with(signals, MUSCLE_FORCE, force, states)

    def _torque(self, forces: Array, angle: Array, pulls: Pulls) -> Array:
        """Torque at every joint from what the muscles pull with [N m].

        What balances leaves exactly nothing: arms are multiplied by the radius after the sum. And products
        are summed alike whether arms are constants or not: to the last bit as without effects on them.
        """
        return self.sprocket_radius * (arms(self.effects, angle, pulls) * forces).sum(axis=-1)

    def _behind_valves(self, signals: Signals, state: State) -> Signals:
        """`signals` with what is known of the valves; here nothing."""
        return signals

    @property
    def _ends(self) -> tuple[Array, Array]:
        """Angles at which a joint ends [rad]."""
        largest = joint_range(self.muscle, self.sprocket_radius, self.initial_contraction)
        return unwound(self.effects, -largest, 0), unwound(self.effects, largest, 1)

    @property
    def stops(self) -> Mapping[str, tuple[ArrayLike, ArrayLike]]:
        return {"angle": self._ends}

    def constrained(self, state: State) -> State:
        angle, velocity = stopped(state["angle"], state["angular_velocity"], *self._ends)
        return {**state, "angle": angle, "angular_velocity": velocity}


class AbstractOpposedMuscles(AbstractPulledJoints):
    r"""One joint between two muscles that pull against each other, with dry friction of threads and bearing.

    .. math:: J \ddot θ = R (F_1 - F_2), \quad x_{1,2} = ε_0 l_0 ± R θ ≥ 0, \quad F_i ≥ 0

    [T], antagonist section. A positive angle shortens muscle 1.
    """

    inertia: eqx.AbstractVar[Scalar]

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = self._up_to_the_muscles(state, held, states, SIDES)
        loose = self._load(signals, signals.muscle_force, states)
        signals = with_contacts(self.effects, signals, self._dry_limits)
        of_all_threads, in_bearing = self._dry_limits(signals)
        built_up = bristle(self.effects, states, signals)
        slip = slip_of_mass(
            loose.load, self.inertia * signals.velocity, of_all_threads + in_bearing, held.widening,
            built_up, self.inertia,
        )  # fmt: skip
        of_threads, of_bearing = slips(slip, built_up)
        in_threads = self._in_threads(signals)
        rubbed = self._load(signals, signals.muscle_force - in_threads * SIDES * of_threads, states)
        return rubbed.having(load=rubbed.load - in_bearing * of_bearing)

    def _in_threads(self, signals: Signals) -> Array:
        """Limit of the dry friction in the threads of each muscle [N]."""
        return friction_limit(self.effects, MUSCLE_FORCE, signals) * jnp.ones(2)

    def _dry_limits(self, signals: Signals) -> tuple[Array, Array | float]:
        """Limits of dry friction of all threads together and in the bearing [N m]."""
        of_threads = self._torque(self._in_threads(signals) * SIDES, signals.position, SIDES)
        return of_threads, friction_limit(self.effects, LOAD, signals)

    def _load(self, signals: Signals, muscle_force: Array, states: States) -> Signals:
        """The chain from the muscle forces, which cannot push, to the torque on the joint."""
        pulling = signals.having(muscle_force=tension(muscle_force))
        torque = self._torque(pulling.muscle_force, signals.position, SIDES)
        return self._with(pulling, LOAD, torque, states)

    def _motion_rates(self, state: State, signals: Signals) -> State:
        """Rates of the angle, of its rate and of the effects' states."""
        acceleration = signals.load / self.inertia
        return {
            "angle": signals.velocity,
            "angular_velocity": stopped_acceleration(acceleration, signals.position, *self._ends),
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }


def regulated_pressures(
    commands: tuple[str, ...], pressures: tuple[str, ...], given: tuple[str, ...] = ()
) -> tuple[Variable, ...]:
    """Variables of regulators: columns of their commands and, in the same order, of their pressures.

    Args:
        given: states that are taken as measured where the pressures are predicted.
    """
    check = "regulated pressure"
    return (
        *(Command(name, "Pa") for name in commands),
        StateVariable("pressure", "Pa", pressures, rest="ambient_pressure", check=check),
        StateVariable("pressure_rate", "Pa/s"),
        Reading("pressure", given=given, signal="command"),
    )


def muscle_joints(
    commands: tuple[str, ...], pressures: tuple[str, ...], angles: tuple[str, ...]
) -> tuple[Variable, ...]:
    """Variables of joints that muscles with regulators turn: their columns."""
    return (
        *regulated_pressures(commands, pressures, given=("angle", "angular_velocity")),
        *joint_angles(angles),
    )


class AbstractRegulated(AbstractActuator):
    """Commands → regulated pressures, one or one a muscle; the pressure and its rate are states."""

    regulator: eqx.AbstractVar[PressureRegulator]

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        return measured["pressure"]

    def _behind_valves(self, signals: Signals, state: State) -> Signals:
        return signals.having(neutral=state["pressure"])

    def _pressure_rates(self, state: State, signals: Signals) -> State:
        """Rates of the pressure and of its rate."""
        acceleration = self.regulator.acceleration(signals.command, signals.pressure, state["pressure_rate"])
        return {"pressure": state["pressure_rate"], "pressure_rate": acceleration}


class AbstractMuscleJoints(AbstractRegulated, AbstractPulledJoints):
    """Equal muscles on sprockets of one radius; pressures and angles are measured."""

    units: ClassVar = {"load": "N m", "motion": "rad"}
    quantities: ClassVar = {
        "regulator_frequency": "regulator.frequency",
        "regulator_damping": "regulator.damping",
        **AbstractPulledJoints.quantities,
    }

    def rest(self, measured: Mapping[str, Array]) -> State:
        return self.constrained({"pressure_rate": jnp.zeros(len(self.commands)), **measured})

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"pressure": signals.pressure, "angle": signals.position}


class Joint(AbstractOpposedMuscles, AbstractMuscleJoints):
    r"""Rig `joint`: commands → regulated pressures → muscle forces → joint angle.

    .. math:: J \ddot θ = R (F_1 - F_2), \quad x_{1,2} = ε_0 l_0 ± R θ ≥ 0, \quad F_i ≥ 0

    [T], antagonist section. A positive angle shortens muscle 1. The joint ends at ±ε0 l0/R, where a muscle
    is at its full length, which its braid does not let it pass; the stop is inelastic. Arrays run over the
    two muscles.
    """

    rig: ClassVar = "joint"
    quantities: ClassVar = {**AbstractMuscleJoints.quantities, "inertia": "inertia"}
    variables: ClassVar = muscle_joints(("command_1", "command_2"), ("pressure_1", "pressure_2"), ("angle",))
    available: ClassVar = frozenset(
        "command past time neutral spool pressure muscle muscle_pair contraction contraction_velocity "
        "position velocity angle slip sprocket".split()
    )

    channel: ClassVar = ControlChannel("angle")

    regulator: PressureRegulator
    muscle: McKibben
    inertia: Scalar = parameter("kg m^2", "moment of inertia of the joint", positive=True)
    sprocket_radius: Scalar = parameter("m", "radius of the sprocket", positive=True)
    initial_contraction: Scalar = parameter("", "contraction ratio of both muscles at angle 0")
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def actuation(self, mean_pressure: ArrayLike = 2.5e5) -> Actuation:
        """Commands P0 ± ΔU, between no pressure and twice the mean one ([T]).

        `mean_pressure`: P0, gauge [Pa].
        """
        ambient, mean, side = self.ambient_pressure, jnp.asarray(mean_pressure, dtype=float), jnp.ones(2)
        rest, highest = (ambient + mean) * side, (ambient + 2 * mean) * side
        return Actuation(rest, jnp.asarray(SIDES), ambient * side, highest)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {**self._pressure_rates(state, signals), **self._motion_rates(state, signals)}
