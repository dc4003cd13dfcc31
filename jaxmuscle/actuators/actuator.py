"""Interface of an actuator model: all that the rest of the package knows about it."""

import abc
import inspect
from collections.abc import Mapping
from typing import Any, ClassVar, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike

from jaxmuscle.actuators.actuator_view import actuator_view
from jaxmuscle.actuators.control_channel import Actuation, ControlChannel
from jaxmuscle.actuators.sensing import reading_slots
from jaxmuscle.actuators.variables import (
    Column,
    Link,
    StateVariable,
    Variable,
    class_variables,
    column_units,
    rate_unit,
)
from jaxmuscle.effects.base import AbstractEffect, States
from jaxmuscle.effects.chain import filled
from jaxmuscle.effects.names import effect_named
from jaxmuscle.effects.readings import column_signal, measured_columns
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import get
from jaxmuscle.signals import Past, Signals, Slot

LISTED_UNITS = {
    "pressure": "Pa",
    "supply_pressure": "Pa",
    "position": "m",
    "angle": "rad",
    "force": "N",
    "current": "A",
}
"""Column of the older form → its SI unit; a number that tells muscles apart ("pressure_1") is left out."""
OLDER = ("commands", "measured", "derivatives", "imposed", "outputs", "links")
"""Class variables of the older form; `variables` has the place of all of them."""


def listed_variables(older: Mapping[str, Any], command: str | None, paths: set[str]) -> dict[str, Any]:
    """Columns and states of a rig in the older form, as far as their units are listed.

    Columns of pressure are absolute; a state that they measure rests at the rig's `ambient_pressure`.

    Args:
        older: the class variables `OLDER`.
        command: unit of the command.
        paths: names of the rig's fields.
    """
    names = (*older["commands"], *_names(older["measured"]), *_names(older["outputs"]))
    units = {name: _listed_unit(name, command) for name in names}
    columns = {name: Column(name, unit) for name, unit in units.items() if unit is not None}
    rates = {base: rate for rate, base in older["derivatives"].items()}
    states: dict[str, StateVariable] = {}
    for name, group in older["measured"].items():
        unit = units[group[0]] or ""
        rest = "ambient_pressure" if unit == "Pa" and "ambient_pressure" in paths else 0.0
        imposed = name in older["imposed"]
        states[name] = StateVariable(name, unit, group, rest, rates.get(name), imposed)
    for rate, base in older["derivatives"].items():
        states[rate] = StateVariable(rate, rate_unit(states[base].unit))
    return {"columns": columns, "states": states}


def _names(groups: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
    return tuple(name for group in groups.values() for name in group)


def _listed_unit(column: str, command: str | None) -> str | None:
    """SI unit of a column, `None` for one of another name."""
    stem = column.rstrip("0123456789").removesuffix("_")
    return command if stem == "command" and command else LISTED_UNITS.get(stem)


def _fields(cls: type) -> set[str]:
    """Names of the fields and properties in the body of a class, before they are made."""
    properties = {name for name, value in cls.__dict__.items() if isinstance(value, property)}
    return properties | set(inspect.get_annotations(cls))


Machine = TypeVar("Machine", bound="AbstractActuator")

OF_A_MUSCLE = frozenset({"contraction_ratio", "muscle_force"})
"""Signals that a rig with a braided muscle has with it. Another one that pulls lists them itself, and not
``muscle``: effects that ask for the geometry of braid and bladder are none of its."""

State = dict[str, Any]
"""Name of a state → array; the integrated states of effects are under ``"effects"``."""


class Held(eqx.Module):
    """What stays as it is during one solver step: the command, its past, the memories of effects.

    `widening`: how many times as wide as it is dry friction is smoothed (:func:`slip_of_mass`; `None`: once).
    `time`: since the first row of the recording [s]; `None` where no effect reads it.
    """

    command: Any
    past: Past | None
    memory: States
    widening: Array | None = None
    time: Array | None = None


class AbstractActuator(eqx.Module):
    """A machine: states, the chain of signals, what is measured.

    A rig declares its commands, states and readings once, in `variables`; from them further class variables
    follow when the class is made. The older form, a class that gives `commands` to `links` itself and no
    `variables`, is still read, with columns of the names in
    :data:`jaxmuscle.actuators.actuator.LISTED_UNITS`.

    Class variables:
        rig: the name that cards use.
        variables: commands, states and readings with their units and columns.
        units: units of the load and its motion, for parameters that depend on the rig; that of the first
            command joins them.
        quantities: card name → path of the parameter.
        available: signals that an effect may read here.
        largest_step: longest solver step that keeps the rig's error well below its sensors' noise [s].
        channel: what a controller of one reading sees and does here; none unless declared.

    Class variables that follow:
        columns: column of a recording → its unit.
        unit_templates: what a unit of a parameter may name: `units`, and ``column NAME`` and ``rate NAME``.
        states: state → what is declared of it; rates of measured states too.
        commands: columns of the command, one or one a muscle.
        measured: state → column(s) that measure it.
        derivatives: state → the measured state of which it is the rate.
        imposed: states that the bench imposes; never predicted.
        outputs: reading → column(s), what the model has to predict.
        links: the chain, each link with its measured inputs.

    Raises:
        InputError: when the class is made: `variables` that contradict themselves or name what is not there.
    """

    rig: ClassVar[str]
    variables: ClassVar[tuple[Variable, ...]]
    units: ClassVar[Mapping[str, str]]
    quantities: ClassVar[Mapping[str, str]]
    available: ClassVar[frozenset[str]]
    largest_step: ClassVar[float]
    channel: ClassVar[ControlChannel | None] = None
    instead_of_a_channel: ClassVar[str] = ""
    columns: ClassVar[Mapping[str, Column]] = {}
    unit_templates: ClassVar[Mapping[str, str]] = {}
    states: ClassVar[Mapping[str, StateVariable]] = {}
    commands: ClassVar[tuple[str, ...]]
    measured: ClassVar[Mapping[str, tuple[str, ...]]]
    derivatives: ClassVar[Mapping[str, str]]
    imposed: ClassVar[tuple[str, ...]]
    outputs: ClassVar[Mapping[str, tuple[str, ...]]]
    links: ClassVar[tuple[Link, ...]]
    effects: eqx.AbstractVar[dict[str, AbstractEffect]]

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Check what the class declares, and set the class variables that follow from it."""
        super().__init_subclass__(**kwargs)
        paths = {name for base in cls.__mro__ for name in _fields(base)}
        older = sorted(cls.__dict__.keys() & {*OLDER})
        units: Mapping[str, str] = getattr(cls, "units", {})
        found: dict[str, Any] = {}
        if hasattr(cls, "variables"):
            if older:
                raise InputError(f"{cls.__name__}: {', '.join(older)} follow from variables; change these")
            if cls.__dict__.keys() & {"variables", "units"}:
                found = class_variables(cls.__name__, cls.variables, units, paths)
        elif older and all(hasattr(cls, name) for name in OLDER):
            found = listed_variables(
                {name: getattr(cls, name) for name in OLDER}, units.get("command"), paths
            )
        for name, value in found.items():
            setattr(cls, name, value)
        if hasattr(cls, "units"):
            cls.unit_templates = {**cls.units, **column_units(cls.columns.values())}
        if cls.channel is not None and hasattr(cls, "outputs"):
            cls.channel = cls.channel.checked(cls.__name__, cls.units, cls.outputs, len(cls.commands), paths)

    def _repr_html_(self) -> str:
        """What a notebook shows: chain, parameters in units of the right size, effects."""
        return actuator_view(self, self.rig, self.commands, self.links, self.effects).html()

    @classmethod
    def column(cls, name: str) -> Column:
        """What the rig declares of a column of its recordings.

        Raises:
            InputError: it declares no unit of that column.
        """
        if name not in cls.columns:
            listed = ", ".join(("command", "time", *LISTED_UNITS))
            raise InputError(
                f"column {name!r}: expected one of {listed}, or such with a number: {name}_1; for "
                f"a column of another kind rig {cls.rig!r} has to declare its `variables`"
            )
        return cls.columns[name]

    def at_rest(self, state: str) -> Array:
        """The value at which a measured state or a rate begins when nothing else is said [SI].

        A number, or one for each of its columns.
        """
        rest, columns = self.states[state].rest, self.measured[self.derivatives.get(state, state)]
        value = get(self, rest) if isinstance(rest, str) else rest
        return jnp.broadcast_to(jnp.asarray(value, dtype=float), (len(columns),) if len(columns) > 1 else ())

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

    @classmethod
    def declared_channel(cls) -> ControlChannel:
        """The rig's `channel`.

        Raises:
            InputError: it declares none.
        """
        if cls.channel is None:
            raise InputError(
                f"rig {cls.rig!r} declares no control channel: declare `channel`, a ControlChannel, or make "
                f"a control.Attached for it{cls.instead_of_a_channel}"
            )
        return cls.channel

    def actuation(self) -> Actuation:
        """What an output of a controller does to the commands, as `channel` declares it.

        A rig may define it anew, with keywords of its own, which :func:`jaxmuscle.control.feedback_on` hands
        on to it.

        Raises:
            InputError: the rig declares no channel.
        """
        return self.declared_channel().actuation(self, len(self.commands))

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

    @property
    def stops(self) -> Mapping[str, tuple[ArrayLike, ArrayLike]]:
        """Measured state → where the machine as modelled ends, on either side.

        What goes on beyond is outside the model: readings there are not predicted.
        """
        return {}

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
        return effect.reads <= cls.readable()

    @classmethod
    def reading_slots(cls) -> dict[Slot, str]:
        """Slot of the reading of pressure, and of that of the motion → the output that it is."""
        return reading_slots(cls.outputs, cls.columns, cls.units.get("motion"))

    @classmethod
    def readable(cls) -> frozenset[str]:
        """All that an effect may read here: `available`, readings of the chain, measured columns."""
        columns = {column_signal(column) for column in measured_columns(cls)}
        of_muscle = OF_A_MUSCLE if "muscle" in cls.available else frozenset()
        return cls.available | of_muscle | {slot.name for slot in cls.reading_slots()} | columns

    @classmethod
    def effect_named(cls, name: str) -> type[AbstractEffect]:
        """The class of the effect `name` that this rig offers; without one, its first form.

        `KeyError` when no effect has that name.
        """
        if (first := effect_named(name)) is None:
            raise KeyError(name)
        return next((form for form in (first, *first.forms) if cls.offers(form)), first)

    def _with(self, signals: Signals, slot: Slot, value: Array, states: States) -> Signals:
        """`signals` with the slot filled by `value` and by what the effects add to it."""
        return filled(self.effects, slot, value, states, signals)
