"""A rig that is not in the package, as a user would write it, and an effect with arrays of parameters."""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import jaxmuscle as jm
from jaxmuscle.actuators import AbstractActuator, Link
from jaxmuscle.effects.base import AbstractEffect, AbstractStaticEffect
from jaxmuscle.effects.slip import friction_limit, slip_of_mass
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import COMMAND, LOAD, Signals


class Drive(AbstractActuator):
    """m x'' = g u + effects on the load."""

    rig: ClassVar = "tested-drive"
    units: ClassVar = {"command": "V", "load": "N", "motion": "m"}
    quantities: ClassVar = {"mass": "mass", "gain": "gain"}
    commands: ClassVar = ("command",)
    measured: ClassVar = {"position": ("position",)}
    derivatives: ClassVar = {"velocity": "position"}
    imposed: ClassVar = ()
    outputs: ClassVar = {"position": ("position",)}
    links: ClassVar = (Link("position", (), "load"),)
    available: ClassVar = frozenset({"command", "past", "position", "velocity"})
    largest_step: ClassVar = 1e-2

    mass: Scalar = parameter("kg", "moving mass", positive=True)
    gain: Scalar = parameter("N/V", "force per command", positive=True)
    effects: dict[str, AbstractEffect] = eqx.field(default_factory=dict)

    def rest(self, measured):
        return dict(measured)

    def resting_command(self, measured):
        return jnp.zeros(())

    def signals(self, state, held):
        signals = Signals(past=held.past, position=state["position"], velocity=state["velocity"])
        signals = self._with(signals, COMMAND, held.command, held.memory)
        signals = self._with(signals, LOAD, self.gain * signals.command, held.memory)
        limit = friction_limit(self.effects, LOAD, signals)
        slip = slip_of_mass(signals.load, self.mass * signals.velocity, limit, held.widening)
        return signals.having(load=signals.load - limit * slip)

    def vector_field(self, state, held):
        signals = self.signals(state, held)
        return {"position": state["velocity"], "velocity": signals.load / self.mass, "effects": {}}

    def readings(self, signals):
        return {"position": signals.position}

    def constrained(self, state):
        return state


class Spring(AbstractStaticEffect):
    """A spring with a force for each power of the position, from the first on."""

    name: ClassVar = "spring"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"position"})
    strength: ClassVar = "stiffness"
    starts: ClassVar = ({},)
    source: ClassVar = "test"

    stiffness: Array = parameter("N/m", "force per power of the position", typical=1.0)

    def value(self, signals):
        powers = jnp.stack([signals.position, 100 * signals.position**3])
        return -(self.stiffness * powers).sum()


STEP = 0.01
TRUE = {"mass": 4.0, "stiffness": (60.0, 20.0), "damping": 8.0}


def drive(mass=4.0, stiffness=(60.0, 20.0), damping=8.0):
    """The drive on its spring."""
    bare = Drive(mass=mass, gain=10.0)  # pyright: ignore[reportArgumentType]
    spring = Spring(np.array(stiffness))  # pyright: ignore[reportArgumentType]
    oil = jm.effects.LoadDamping(coefficient=damping)  # pyright: ignore[reportArgumentType]
    return bare.with_effects(spring=spring, load_damping=oil)


def measured(seed=0, samples=400):
    """Command and position of the true drive by fine Euler steps in plain NumPy."""
    t = STEP * np.arange(samples)
    command, x, v, found = np.sin(3 * t) + 0.6 * np.sin(7 * t + 1), 0.0, 0.0, []
    for u in command:
        found.append(x)
        for _ in range(200):
            a, b = TRUE["stiffness"]
            pull = 10.0 * u - a * x - 100 * b * x**3 - TRUE["damping"] * v
            v += STEP / 200 * pull / TRUE["mass"]
            x += STEP / 200 * v
    noise = 1e-4 * np.random.default_rng(seed).normal(size=samples)
    return {"command": command, "position": np.array(found) + noise}
