"""Names of parameters and their paths, there and back: what cards, fits, sweeps and reports go by.

A parameter of a machine goes by its card's name of it (``"end_factor"``) and by its dotted path
(``"muscle.end_factor"``), an entry of an array by the indices behind its path
(``"hysteresis.weights[3]"``), a parameter of an effect by its path with or without the leading ``effects.``
(``"creep.stiffness"``). Beside the machine there are the offset of a sensor (``"offset.position"``) and a
state at the first sample of a recording (``"start.opening"``).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TypeVar

import equinox as eqx
import jax.numpy as jnp

from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import Parameter, entries_of, get, parameters

EFFECTS = "effects."
OFFSET = "offset."
"""Prefix of the constant that a sensor adds to its column."""
CONSTANT = "constant:"
"""What results put before the name of a quantity of the card that is found to be wrong."""
START = "start."
"""Prefix of a state at the first sample of a recording."""
Value = TypeVar("Value")


def of_machine(path: str) -> bool:
    """Whether a path leads into the machine, not to a sensor or to the beginning of a recording."""
    return not path.startswith((OFFSET, START))


def column_of_offset(path: str) -> str | None:
    """The column whose sensor's offset this is; `None` for anything else."""
    return path.removeprefix(OFFSET) if path.startswith(OFFSET) else None


def effect_path(effect: str, parameter: str) -> str:
    """The path of a parameter of an effect."""
    return f"{EFFECTS}{effect}.{parameter}"


def split_effect(path: str) -> tuple[str | None, str]:
    """(effect, its parameter) of a path; (`None`, `path`) of anything that belongs to no effect."""
    if not path.startswith(EFFECTS):
        return None, path
    effect, _, parameter = path.removeprefix(EFFECTS).partition(".")
    return effect, parameter


def of_effect(effect: str, values: Mapping[str, Value]) -> dict[str, Value]:
    """Parameter → value of one effect, out of values by path."""
    split = {path: split_effect(path) for path in values}
    return {parameter: values[path] for path, (owner, parameter) in split.items() if owner == effect}


def card_name(quantities: Mapping[str, str], path: str) -> str:
    """The name on cards of what stands at a path; the path itself where cards have no name for it.

    Args:
        quantities: name on the card → path, as a rig declares them.
    """
    return next((name for name, place in quantities.items() if place == path), path)


def known_names(machine: eqx.Module) -> dict[str, Parameter]:
    """Every parameter of a machine, and every entry of those that are arrays, by all of its names."""
    found: dict[str, Parameter] = {}
    quantities = getattr(machine, "quantities", {})
    for path, whole in parameters(machine).items():
        for own in dict.fromkeys((path, *entries_of(path, whole.value))):
            value, name = get(machine, own), card_name(quantities, own)
            value = float(value) if jnp.ndim(value) == 0 else value
            entry = dataclasses.replace(whole, path=own, name=name, value=value)
            found[own] = found[name] = entry
            if own.startswith(EFFECTS):
                found.setdefault(own.removeprefix(EFFECTS), entry)
    return found


def resolve(known: Mapping[str, Parameter], name: str, where: str) -> Parameter:
    """What `name` stands for.

    Args:
        known: name → parameter, as :func:`known_names` gives it, with what there is beside the machine.
        where: the argument that the name came in, for the message.

    Raises:
        InputError: there is no such parameter; the message has the nearest name.
    """
    if name in known:
        return known[name]
    raise InputError(f"{where}: unknown parameter {name!r}{nearest(name, known)}")


def expanded(known: Mapping[str, Parameter], parameter: Parameter) -> list[Parameter]:
    """The parameter itself, or all entries of an array."""
    return [known[path] for path in entries_of(parameter.path, parameter.value)]
