"""Interface of an effect: an addition to one signal of the chain, vanishing exactly at zero strength.
A machine has effects by name, :data:`Effects`.

Three kinds: static (no state), with a state that has a rate, and with a memory that is updated exactly at
the end of each solver step. An effect declares the slot it adds to, the signals it reads, and the
parameter that is its strength; rigs and the diagnosis know nothing else about it.
"""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, ArrayLike, PyTree

from jaxmuscle.signals import Signals, Slot

VARIABLE, LOOP, COMMANDED, LOG_TIME, TIME = "variable", "loop", "command", "log time", "time"
"""What reveals an effect: a measured variable, one that rises and falls, the command, the time since the
machine was last moved, the time of the recording."""


class AbstractEffect(eqx.Module):
    """Common to all effects.

    Class variables:
        name: the name that cards use.
        kind: the name that results use: `name` unless it is one error of a sensor for each column.
        column: the column whose sensor it is an error of; `None` of other effects.
        slot: the signal it adds to.
        reads: names of the signals that it needs; it is offered only to rigs that have them.
        strength: the parameter at whose zero value, and that of the `further_strengths`, the addition is
            exactly zero.
        further_strengths: parameters that make an addition where the strength is zero, too.
        largest: size of the strength that no real machine exceeds (SI); `None` where that depends on the
            machine, or on the recording (:meth:`largest_on`). A diagnosis finds no effect beyond it.
        starts: alternative values of its other parameters from which a search begins.
        source: where the equation comes from.
        stage: effects of one slot act in the order of their stages, each on what those of the stages
            before have left; those of one stage all see the same.
        view: what the report of a diagnosis shows it against, :data:`VARIABLE` or another of those.
        forms: classes that are this effect, under its name, on rigs that do not offer this class.
    """

    name: ClassVar[str]
    kind: ClassVar[str]
    column: ClassVar[str | None] = None
    slot: ClassVar[Slot]
    reads: ClassVar[frozenset[str]]
    strength: ClassVar[str]
    further_strengths: ClassVar[tuple[str, ...]] = ()
    largest: ClassVar[float | None] = None
    starts: ClassVar[tuple[Mapping[str, float], ...]]
    source: ClassVar[str]
    stage: ClassVar[int] = 0
    view: ClassVar[str] = VARIABLE
    forms: ClassVar[tuple[type[AbstractEffect], ...]] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Without a kind of its own a class with a name is of the kind of that name."""
        super().__init_subclass__(**kwargs)
        own = vars(cls)
        if "name" in own and "kind" not in own:
            cls.kind = own["name"]

    def largest_on(self, duration: float, ranges: Mapping[str, float]) -> float | None:
        """Size of the strength that no real machine exceeds on a recording; `largest` on any by default.

        Args:
            duration: of the recording, without what is held out [s].
            ranges: name of the slot of a reading → range of what was recorded there (SI), from the smallest
                to the largest value, with what an unloaded sensor shows among them.
        """
        return self.largest


def strengths_of(effect: type[AbstractEffect]) -> tuple[str, ...]:
    """Names of the parameters of which one at least is not zero where there is an effect."""
    return effect.strength, *effect.further_strengths


class AbstractStaticEffect(AbstractEffect):
    """An effect without a state."""

    @abc.abstractmethod
    def value(self, signals: Signals) -> Array:
        """The addition to the slot, in its unit."""


class AbstractWallEffect(AbstractStaticEffect):
    """A static effect of the muscle's wall, which takes room from the chamber as well."""

    @abc.abstractmethod
    def room(self, muscle: Any, contraction: Array) -> tuple[Array, Array]:
        """Volume that it takes [m^3], and the slope of that over the contraction [m^2]."""


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
    """An effect that changes the sprockets by which muscles turn a joint, as additions that vanish.

    Of the two muscles of a joint, number 0 shortens with the angle, number 1 lengthens.
    """

    @abc.abstractmethod
    def winding(self, angle: Array, muscle: ArrayLike) -> Array:
        """Addition to the angle by which the chain of a muscle is wound up on the mean radius [rad], zero at
        angle 0.
        """

    @abc.abstractmethod
    def lever(self, angle: Array, muscle: ArrayLike) -> Array:
        """Addition to the ratio of its lever arm to the mean radius, the slope of :meth:`winding`."""


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

    The value is the share of the limit that the friction of each contact has built up, of the threads and of
    guide or bearing. A rig that hands a bristle to :func:`slip_of_mass` says so by ``slip`` among its
    `available` signals, and before it asks for the bristle fills in the limit of each contact and how large
    it is over that at rest (:func:`jaxmuscle.effects.contacts.with_contacts`).
    """

    @abc.abstractmethod
    def deflection(self) -> Array:
        """Way over which friction at rest builds up, in the unit of the motion; zero without the effect."""

    @abc.abstractmethod
    def damping(self) -> Array:
        """Damping of what builds up over its stiffness [s]."""


Effects = Mapping[str, AbstractEffect]
States = Mapping[str, Any]
