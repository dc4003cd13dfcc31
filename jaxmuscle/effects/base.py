"""Interface of an effect: an addition to one signal of the chain, vanishing exactly at zero strength.
Effects are known by name; a user's own joins them with :func:`register`.

Three kinds: static (no state), with a state that has a rate, and with a memory that is updated exactly at
the end of each solver step. An effect declares the slot it adds to, the signals it reads, and the
parameter that is its strength; rigs and the diagnosis know nothing else about it.
"""

from __future__ import annotations

import abc
import dataclasses
import inspect
import re
from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, PyTree

from jaxmuscle.errors import InputError
from jaxmuscle.signals import Signals, Slot


class AbstractEffect(eqx.Module):
    """Common to all effects.

    Class variables:
        name: the name that cards use.
        kind: the name that results use: `name` unless it is one error of a sensor for each column.
        column: the column whose sensor it is an error of; `None` of other effects.
        slot: the signal it adds to.
        reads: names of the signals that it needs; it is offered only to rigs that have them.
        strength: the parameter at whose zero value the addition is exactly zero.
        starts: alternative values of its other parameters from which a search begins.
        source: where the equation comes from.
        stage: effects of one slot act in the order of their stages, each on what those of the stages
            before have left; those of one stage all see the same.
        forms: classes that are this effect, under its name, on rigs that do not offer this class.
    """

    name: ClassVar[str]
    kind: ClassVar[str]
    column: ClassVar[str | None] = None
    slot: ClassVar[Slot]
    reads: ClassVar[frozenset[str]]
    strength: ClassVar[str]
    starts: ClassVar[tuple[Mapping[str, float], ...]]
    source: ClassVar[str]
    stage: ClassVar[int] = 0
    forms: ClassVar[tuple[type[AbstractEffect], ...]] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Without a kind of its own a class with a name is of the kind of that name."""
        super().__init_subclass__(**kwargs)
        own = vars(cls)
        if "name" in own and "kind" not in own:
            cls.kind = own["name"]


class AbstractStaticEffect(AbstractEffect):
    """An effect without a state."""

    @abc.abstractmethod
    def value(self, signals: Signals) -> Array:
        """The addition to the slot, in its unit."""


class AbstractMuscleEffect(AbstractEffect):
    """An effect that makes the muscles themselves other than the card says; the chain follows from them."""

    @abc.abstractmethod
    def altered(self, muscle: Any) -> Any:
        """The muscle component as it really is; exactly `muscle` at zero strength."""


class AbstractFrictionEffect(AbstractEffect):
    r"""Dry friction: a limit, of which the machine uses the part that the motion calls for.

    The addition is -limit·slip, with a slip of 1 while sliding forward, -1 while sliding backward and
    in between while sticking; each machine works it out (:func:`slip_of_mass`, :func:`slip_of_velocity`).
    """

    @abc.abstractmethod
    def limit(self, signals: Signals) -> Array:
        """The largest friction force, in the unit of the slot, not negative."""


class AbstractTransmissionEffect(AbstractEffect):
    """An effect that changes the sprockets by which muscles turn a joint, as additions that vanish."""

    @abc.abstractmethod
    def winding(self, angle: Array) -> Array:
        """Addition to the angle by which chain is wound up on the mean radius [rad], zero at angle 0."""

    @abc.abstractmethod
    def lever(self, angle: Array) -> Array:
        """Addition to the ratio of the lever arm to the mean radius, the slope of :meth:`winding`."""


class AbstractRateEffect(AbstractEffect):
    """An effect with a state that is integrated with the machine's own."""

    @abc.abstractmethod
    def initial(self, signals: Signals) -> PyTree:
        """The state at rest under the given signals."""

    @abc.abstractmethod
    def rate(self, state: PyTree, signals: Signals) -> PyTree:
        """Time derivative of the state."""

    @abc.abstractmethod
    def value(self, state: PyTree, signals: Signals) -> Array:
        """The addition to the slot, in its unit."""


class AbstractMemoryEffect(AbstractEffect):
    """An effect with a memory that is brought up to date at the end of each solver step, without error."""

    @abc.abstractmethod
    def initial(self, signals: Signals) -> PyTree:
        """The memory at rest under the given signals."""

    @abc.abstractmethod
    def update(self, memory: PyTree, signals: Signals, step: Array) -> PyTree:
        """The memory after `step` seconds that ended with `signals`."""

    @abc.abstractmethod
    def value(self, memory: PyTree, signals: Signals) -> Array:
        """The addition to the slot, in its unit."""


class AbstractSlipEffect(AbstractMemoryEffect):
    """An effect that changes how dry friction builds up on the way; a machine asks for its :class:`Bristle`.

    The value is the share of the friction's limit that has built up, from -1 to 1. A rig that hands a
    bristle to :func:`slip_of_mass` says so by ``slip`` among its `available` signals.
    """

    @abc.abstractmethod
    def deflection(self) -> Array:
        """Way over which the friction builds up, in the unit of the motion; zero without the effect."""


class Bristle(NamedTuple):
    """Share of the limit to which dry friction has built up, -1 to 1, and the way that it takes."""

    share: Array
    distance: Array


_ELSEWHERE = (AbstractFrictionEffect, AbstractMuscleEffect, AbstractTransmissionEffect, AbstractSlipEffect)
"""Effects that do not add to their slot as the chain fills it."""
_WITH_STATE = (AbstractRateEffect, AbstractMemoryEffect)

STICKING_TIME = 5e-4
"""Time constant with which a sticking mass comes to rest [s]: short against anything that is sampled."""

Effects = Mapping[str, AbstractEffect]
States = Mapping[str, Any]


def filled(effects: Effects, slot: Slot, value: Array, states: States, signals: Signals) -> Signals:
    """`signals` with the slot filled by `value` and by what its effects add to it, stage by stage.

    Dry friction is left to the machine, which knows what the motion calls for: :func:`friction_limit`;
    what alters muscles or sprockets acts before: :func:`altered_muscle`,
    :func:`jaxmuscle.effects.transmission.winding`.
    """
    acting = {n: e for n, e in effects.items() if e.slot == slot and not isinstance(e, _ELSEWHERE)}
    signals = signals.having(**{slot.name: value})
    for stage in sorted({effect.stage for effect in acting.values()}):
        found = getattr(signals, slot.name)
        total: Array | float = 0.0
        for name, effect in acting.items():
            if effect.stage == stage:
                total = total + effect_value(effect, states.get(name), signals)
        here = {n: found for n, e in acting.items() if e.stage == stage and isinstance(e, _WITH_STATE)}
        signals = signals.having(**{slot.name: found + total}, found={**signals.found, **here})
    return signals


def effect_value(effect: AbstractEffect, state: Any, signals: Signals) -> Array:
    """The addition of one effect other than dry friction, with or without a state."""
    if isinstance(effect, AbstractStaticEffect):
        return effect.value(signals)
    assert isinstance(effect, AbstractRateEffect | AbstractMemoryEffect)
    return effect.value(state, signals)


def altered_muscle(effects: Effects, muscle: Any) -> Any:
    """The muscle component after all effects that alter it."""
    for effect in effects.values():
        if isinstance(effect, AbstractMuscleEffect):
            muscle = effect.altered(muscle)
    return muscle


def friction_limit(effects: Effects, slot: Slot, signals: Signals) -> Array | float:
    """Sum of the limits of all dry friction on a slot."""
    limits = [
        e.limit(signals) for e in effects.values() if isinstance(e, AbstractFrictionEffect) and e.slot == slot
    ]
    return sum(limits, start=0.0)


def bristle(effects: Effects, states: States, signals: Signals) -> Bristle | None:
    """How far dry friction has built up; `None` where it acts at once, without an effect on it."""
    for name, effect in effects.items():
        if isinstance(effect, AbstractSlipEffect):
            return Bristle(effect.value(states.get(name), signals), effect.deflection())
    return None


def slip_of_mass(
    driving: Array,
    momentum: Array,
    limit: Array | float,
    widening: Array | float | None = None,
    bristle: Bristle | None = None,
    mass: Array | float = 1.0,
) -> Array:
    r"""Slip of a mass under dry friction: :math:`\mathrm{clip}((F + m v/τ)/L, -1, 1)`.

    The Coulomb law with a true sticking phase (Kikuuwe et al., IEEE Trans. Robotics 22, 2006): friction
    balances the driving force F and brings the mass to rest within τ as long as its limit L suffices, and
    slides at the limit otherwise. Not stiffer than 1/τ however large the friction. At L = 0 it is the sign
    of the driving force, which makes the gradient with respect to the limit that of the sliding phase.

    With a bristle of distance δ that has built up the share z of the limit the slip is
    :math:`\mathrm{clip}((S z + F + m v/τ)/(S + L), -1, 1)`, :math:`S = m δ/(8τ^2)`: one implicit step of
    length τ for a mass on a spring L/δ with damping 8τ L/δ. It is z where z is slow, is as little stiff as
    the law above, and at δ = 0 is that law.

    Args:
        driving: force F.
        momentum: m v.
        limit: L, not negative.
        widening: factor of τ, for the first stages of a fit: `held.widening` of a rig (`None`: 1).
        bristle: how far friction has built up; `None` where it acts at once.
        mass: m, only needed with a bristle.
    """
    wanted = force_to_rest(driving, momentum, widening)
    if bristle is not None:
        softness = mass * softening(bristle.distance, widening)
        wanted, limit = wanted + softness * bristle.share, limit + softness
    some = jnp.asarray(limit) > 0
    ratio = wanted / jnp.where(some, limit, 1.0)
    return jnp.where(some, jnp.clip(ratio, -1.0, 1.0), jnp.sign(wanted))


def force_to_rest(driving: Array, momentum: Array, widening: Array | float | None = None) -> Array:
    """Friction that would bring a mass to rest within τ, F + m v/τ; arguments as :func:`slip_of_mass`."""
    return driving + momentum / _widened(STICKING_TIME, widening)


def softening(distance: Array, widening: Array | float | None = None) -> Array:
    """S/m = δ/(8τ²) of :func:`slip_of_mass`: acceleration that a bristle makes up for, at a distance δ."""
    return distance / (8 * _widened(STICKING_TIME, widening) ** 2)


def slip_of_velocity(
    velocity: Array,
    width: float = 1e-4,
    widening: Array | float | None = None,
    bristle: Bristle | None = None,
) -> Array:
    """Slip where the motion is imposed: tanh(v/width) with a width far below any bench's velocities [m/s].

    `widening`: factor of the width, as in :func:`slip_of_mass`. With a bristle, its share.
    """
    slip = jnp.tanh(velocity / _widened(width, widening))
    return slip if bristle is None else jnp.where(bristle.distance > 0, bristle.share, slip)


def _widened(width: float, widening: Array | float | None) -> Array | float:
    return width if widening is None else width * widening


def _as_found(name: str, effect: AbstractEffect, signals: Signals) -> Signals:
    """The signals of a whole chain as an effect with a state found them: its slot before it acted."""
    return signals.having(**{effect.slot.name: signals.found[name]}) if name in signals.found else signals


def initial_states(effects: Effects, signals: Signals) -> tuple[dict[str, Any], dict[str, Any]]:
    """(integrated states, memories) of all effects at rest under `signals`."""
    rates, memories = (
        {n: e.initial(_as_found(n, e, signals)) for n, e in effects.items() if isinstance(e, kind)}
        for kind in _WITH_STATE
    )
    return rates, memories


def state_rates(effects: Effects, states: States, signals: Signals) -> dict[str, Any]:
    """Time derivatives of all integrated effect states."""
    return {
        n: e.rate(states[n], _as_found(n, e, signals))
        for n, e in effects.items()
        if isinstance(e, AbstractRateEffect)
    }


def updated_memories(effects: Effects, memories: States, signals: Signals, step: Array) -> dict[str, Any]:
    """All memories after a solver step of `step` seconds that ended with `signals`."""
    return {
        n: e.update(memories[n], _as_found(n, e, signals), step)
        for n, e in effects.items()
        if isinstance(e, AbstractMemoryEffect)
    }


Effect = TypeVar("Effect", bound=type[AbstractEffect])

BY_NAME: dict[str, type[AbstractEffect]] = {}
"""Name, as cards and saved fits use it → class; of one with several forms the first."""
DECLARED = ("name", "slot", "reads", "strength", "starts", "source")
"""Class variables that an effect has to have; see :class:`AbstractEffect`."""
BARE = re.compile(r"[A-Za-z0-9_]+")
"""Names that can head a section of a card."""


def register(effect: Effect) -> Effect:
    """Make an effect known by its name, so that cards can declare it and fits with it can be saved.

    A class decorator. A diagnosis, a fit in memory and a report do not need it, and a diagnosis does not
    seek it by itself: name it in ``catalogue=``. Registering the same class again (a cell of a notebook that
    is run twice) replaces it.

    Raises:
        InputError: a class variable is missing, something is still abstract, the strength is no parameter,
            or the name is taken or no name (letters, digits, underscores).
    """
    if missing := [name for name in DECLARED if not hasattr(effect, name)]:
        raise InputError(
            f"{effect.__name__}: expected class variables {', '.join(missing)}; they are missing"
        )
    if inspect.isabstract(effect):
        abstract = ", ".join(sorted(effect.__abstractmethods__))
        raise InputError(f"{effect.__name__}: still abstract; define {abstract}")
    if not BARE.fullmatch(effect.name):
        raise InputError(
            f"{effect.__name__}: expected a name of letters, digits and underscores; got {effect.name!r}"
        )
    own = [field.name for field in dataclasses.fields(effect) if "unit" in field.metadata]
    if effect.strength not in own:
        raise InputError(
            f"{effect.__name__}: expected one of its parameters ({', '.join(own) or 'none'}) as strength; "
            f"got {effect.strength!r}"
        )
    taken = BY_NAME.get(effect.name)
    if taken is not None and effect in taken.forms:
        return effect
    same = (effect.__module__, effect.__qualname__)
    if taken is not None and (taken.__module__, taken.__qualname__) != same:
        raise InputError(
            f"{effect.__name__}: the name {effect.name!r} is that of {taken.__name__}; choose another"
        )
    BY_NAME[effect.name] = effect
    return effect
