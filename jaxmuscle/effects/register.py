"""Register of effects: each is known by its name; a user's own joins them with :func:`register`."""

from __future__ import annotations

import dataclasses
import inspect
import re
from typing import TypeVar

from jaxmuscle.effects.base import AbstractEffect
from jaxmuscle.errors import InputError

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
