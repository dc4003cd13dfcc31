"""Effects by the names that cards and saved fits use: registered ones, errors of sensors of any column."""

from __future__ import annotations

from collections.abc import Iterable

from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.effects.readings import Rig, reading_effect_named, reading_effects
from jaxmuscle.effects.register import BY_NAME


def effect_named(name: str) -> type[AbstractEffect] | None:
    """The class that a name stands for; `None` when there is none.

    Errors of sensors (``sensor_offset_pressure``) need no registration, one for each column of every rig.
    """
    return BY_NAME.get(name) or reading_effect_named(name)


def names_on(rig: Rig | type[Rig]) -> Iterable[str]:
    """Every name that a card of a rig may mean, whether or not the rig has the signals."""
    return (*BY_NAME, *(effect.name for effect in reading_effects(rig)))


def is_registered(name: str, effect: AbstractEffect) -> bool:
    """Whether a card that names `name` means an effect of this very class, on a rig that offers it."""
    known = effect_named(name)
    return known is not None and type(effect) in (known, *known.forms)
