"""What the rest of the package knows about a machine."""

import abc
import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar

import equinox as eqx
from jaxtyping import Array

from jaxmuscle.effects.base import AbstractEffect, States, addition
from jaxmuscle.errors import InputError
from jaxmuscle.signals import Past, Signals, Slot

Machine = TypeVar("Machine", bound="AbstractActuator")

State = dict[str, Any]
"""Name of a state → array; the integrated states of effects are under ``"effects"``."""


class Held(eqx.Module):
    """What stays as it is during one solver step: the command, its past, the memories of effects.

    `widening`: how many times as wide as it is dry friction is smoothed (:func:`slip_of_mass`; `None`: once).
    """

    command: Any
    past: Past | None
    memory: States
    widening: Array | None = None


@dataclasses.dataclass(frozen=True)
class Link:
    """One link of the chain: `output` is predicted while the states `imposed` are taken as measured.

    `signal` is the signal of the chain on which the link's residual bears.
    """

    output: str
    imposed: tuple[str, ...]
    signal: str


class AbstractActuator(eqx.Module):
    """A machine: states, the chain of signals, what is measured.

    Class variables:
        rig: the name that cards use.
        units: units of the command, the load and its motion, for parameters that depend on the rig.
        quantities: card name → path of the parameter.
        commands: columns of the command, one or one a muscle.
        measured: state → column(s) that measure it.
        derivatives: state → the measured state of which it is the rate.
        imposed: states that the bench imposes; never predicted.
        outputs: reading → column(s), what the model has to predict.
        links: the chain, each link with its measured inputs.
        available: signals that an effect may read here.
        largest_step: longest solver step that keeps the rig's error well below its sensors' noise [s].
    """

    rig: ClassVar[str]
    units: ClassVar[Mapping[str, str]]
    quantities: ClassVar[Mapping[str, str]]
    commands: ClassVar[tuple[str, ...]]
    measured: ClassVar[Mapping[str, tuple[str, ...]]]
    derivatives: ClassVar[Mapping[str, str]]
    imposed: ClassVar[tuple[str, ...]]
    outputs: ClassVar[Mapping[str, tuple[str, ...]]]
    links: ClassVar[tuple[Link, ...]]
    available: ClassVar[frozenset[str]]
    largest_step: ClassVar[float]
    effects: eqx.AbstractVar[dict[str, AbstractEffect]]

    @abc.abstractmethod
    def rest(self, measured: Mapping[str, Array]) -> State:
        """The machine's own states with the measured ones as given and the others at rest."""

    def resting_command(self, measured: Mapping[str, Array]) -> Array:
        """The command under which the machine rests at the measured states.

        Every rig with a command defines it.

        Raises:
            InputError: the class does not.
        """
        raise InputError(
            f"{type(self).__name__}: expected a method resting_command(measured), the command under which "
            f"the machine rests, as it has the commands {', '.join(self.commands) or 'none'}"
        )

    @abc.abstractmethod
    def signals(self, state: State, held: Held) -> Signals:
        """The chain from the command to the load under the given state."""

    @abc.abstractmethod
    def vector_field(self, state: State, held: Held) -> State:
        """Time derivatives of all states."""

    def linear_part(self, state: State) -> State:
        """A fast part of the vector field, linear in the state, that is to be integrated exactly.

        Rates of the states that it concerns, with constant coefficients; :meth:`vector_field` contains
        them. Empty for machines without one.
        """
        return {}

    @abc.abstractmethod
    def readings(self, signals: Signals) -> dict[str, Array]:
        """What the sensors show: one entry for each of `outputs`."""

    @abc.abstractmethod
    def constrained(self, state: State) -> State:
        """The state after unilateral contacts have acted, at the end of a solver step."""

    def with_effects(self: Machine, **effects: AbstractEffect) -> Machine:
        """A copy that also does what `effects` say; an effect of the same name is replaced."""
        return eqx.tree_at(lambda m: m.effects, self, {**self.effects, **effects})

    def without_effects(self: Machine, *names: str) -> Machine:
        """A copy without the named effects."""
        kept = {name: effect for name, effect in self.effects.items() if name not in names}
        return eqx.tree_at(lambda m: m.effects, self, kept)

    @classmethod
    def offers(cls, effect: type[AbstractEffect]) -> bool:
        """Whether this rig has the signals that an effect reads."""
        return effect.reads <= cls.available

    def _with(self, signals: Signals, slot: Slot, value: Array, states: States) -> Signals:
        """`signals` with the slot filled by `value` and by what the effects add to it."""
        filled = signals.having(**{slot.name: value})
        return filled.having(**{slot.name: value + addition(self.effects, slot, states, filled)})
