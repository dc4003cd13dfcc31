"""A pressure regulator feeds the muscles of an elbow, whose angle follows the pressure with hysteresis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.actuators.actuator import Held, State
from jaxmuscle.actuators.control_channel import ControlChannel
from jaxmuscle.actuators.joint import AbstractRegulated, regulated_pressures
from jaxmuscle.actuators.variables import Reading, StateVariable
from jaxmuscle.components import PressureRegulator
from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.effects.chain import state_rates
from jaxmuscle.hysteresis import ModifiedPrandtlIshlinskii
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import COMMAND, Signals


class Elbow(AbstractRegulated):
    r"""Rig `elbow`: command → regulated pressure → angle, by the modified Prandtl-Ishlinskii model of [W].

    .. math:: \ddot P = ω^2 (c - P) - 2ζω \dot P, \quad
              θ = p_1 P + p_2 P^3 + \sum_i ρ e^{-τ r_i} F_{γ, r_i}[P], \quad r_i = α i

    P is the gauge pressure [Pa], θ in rad; envelopes and thresholds are plain numbers. The arm is slow: the
    angle is that of rest at the present pressure, and the load is the one under which the parameters were
    identified. The play operators start from 0 and are brought up to date at the end of each solver step.
    """

    rig: ClassVar = "elbow"
    units: ClassVar = {"load": "N m", "motion": "rad", "input": "Pa", "output": "rad"}
    quantities: ClassVar = {
        "regulator_frequency": "regulator.frequency",
        "regulator_damping": "regulator.damping",
        "rising_height": "hysteresis.rising.height",
        "rising_slope": "hysteresis.rising.slope",
        "rising_shift": "hysteresis.rising.shift",
        "rising_level": "hysteresis.rising.level",
        "falling_height": "hysteresis.falling.height",
        "falling_slope": "hysteresis.falling.slope",
        "falling_shift": "hysteresis.falling.shift",
        "falling_level": "hysteresis.falling.level",
        "density": "hysteresis.density",
        "decay": "hysteresis.decay",
        "spacing": "hysteresis.spacing",
        "linear": "hysteresis.linear",
        "cubic": "hysteresis.cubic",
        "ambient_pressure": "ambient_pressure",
    }
    variables: ClassVar = (
        *regulated_pressures(("command",), ("pressure",)),
        StateVariable("plays", ""),
        Reading("angle", "rad", ("angle",), given=("pressure",), signal="position"),
    )
    available: ClassVar = frozenset("command past neutral spool pressure".split())
    largest_step: ClassVar = 0.002
    channel: ClassVar = ControlChannel("angle", rest="ambient_pressure", lowest="ambient_pressure")

    regulator: PressureRegulator
    hysteresis: ModifiedPrandtlIshlinskii
    ambient_pressure: Scalar = parameter("Pa", "pressure of the atmosphere", default=101325.0, positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured: Mapping[str, Array]) -> State:
        gauge = measured["pressure"] - self.ambient_pressure
        plays = self.hysteresis.update(self.hysteresis.rest(), gauge)
        return {"pressure_rate": jnp.zeros(()), "plays": plays, **measured}

    def signals(self, state: State, held: Held) -> Signals:
        states = {**state.get("effects", {}), **held.memory}
        signals = Signals(past=held.past, ambient_pressure=self.ambient_pressure, pressure=state["pressure"])
        signals = self._with(self._behind_valves(signals, state), COMMAND, held.command, states)
        angle = self.hysteresis.output(state["plays"], signals.gauge_pressure)
        return signals.having(position=angle)

    def vector_field(self, state: State, held: Held) -> State:
        signals = self.signals(state, held)
        return {
            **self._pressure_rates(state, signals),
            "plays": jnp.zeros_like(state["plays"]),
            "effects": state_rates(self.effects, state.get("effects", {}), signals),
        }

    def readings(self, signals: Signals) -> dict[str, Array]:
        return {"pressure": signals.pressure, "angle": signals.position}

    def constrained(self, state: State) -> State:
        gauge = state["pressure"] - self.ambient_pressure
        return {**state, "plays": self.hysteresis.update(state["plays"], gauge)}
