"""What can be swept, by the names that users know it by."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator

import equinox as eqx
import jax
import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.parameter_names import START, known_names, resolve
from jaxmuscle.parameters import Parameter, parameters
from jaxmuscle.simulation import Track
from jaxmuscle.sweeps.bench import Bench
from jaxmuscle.sweeps.commands import Function

LOAD = "load."
"""The load of a rig is no component of its own: its parameters stand at the machine."""


def checked_values(parameter: Parameter, name: str, values: object) -> np.ndarray:
    """`values` as an array with one entry a point along its first axis.

    Raises:
        InputError: another shape, not numbers, not finite, or outside the parameter's range.
    """
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"{name}: expected numbers in {parameter.unit or 'plain numbers'}: {error}"
        ) from error
    shape = parameter.shape
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape or not len(array):
        wanted = "n" + "".join(f", {size}" for size in shape)
        raise InputError(f"{name}: expected values of shape ({wanted}); got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name}: expected finite values; got {array[~np.isfinite(array)][0]}")
    if (parameter.positive and array.min() <= 0) or (parameter.nonnegative and array.min() < 0):
        least = "above zero" if parameter.positive else "zero or more"
        raise InputError(f"{name}: has to be {least}; got {array.min():g} {parameter.unit}".rstrip())
    return array


def swept(bench: Bench, name: str) -> Parameter:
    """What `name` stands for, with its path in the :class:`Bench`.

    Args:
        name: any of a parameter of the machine (:mod:`jaxmuscle.parameter_names`), ``command.…`` or
            ``start.…``.

    Raises:
        InputError: an unknown name; the message holds the nearest one.
    """
    known = dict(_known(bench))
    bare = name.removeprefix(LOAD)
    if name.startswith("command.") and name not in known and not callable(bench.command):
        raise InputError(
            f"cannot sweep {name!r}: the command is a table, which has no parameters; "
            f"give a function of time, such as command=jm.commands.Sine()"
        )
    return resolve(known, bare if name not in known and bare in known else name, "sweep")


def _known(bench: Bench) -> Iterator[tuple[str, Parameter]]:
    machine = bench.actuator
    for name, entry in known_names(machine).items():
        yield name, _under("actuator.", entry)
    if isinstance(bench.command, Track):
        return
    if isinstance(bench.command, eqx.Module):
        units = machine.units
        for name, entry in _of_command(bench.command):
            unit = re.sub(r"\{(\w+)\}", lambda found: units.get(found[1], found[0]), entry.unit)
            yield name, dataclasses.replace(entry, unit=unit)
    for name, value in bench.start.items():
        path, unit = START + name, machine.states[name].unit
        yield path, Parameter(path=path, value=value, unit=unit, meaning=f"{name} at the start")


def _under(prefix: str, entry: Parameter) -> Parameter:
    return dataclasses.replace(entry, path=prefix + entry.path)


def _of_command(command: eqx.Module) -> Iterator[tuple[str, Parameter]]:
    """The parameters of a command; numbers that a user's own module holds undeclared have no unit."""
    if isinstance(command, Function):
        for name, value in command.parameters.items():
            yield f"command.{name}", Parameter(path=f"command.parameters.{name}", value=value)
        return
    for name, value in vars(command).items():
        if isinstance(value, float | int | np.ndarray | jax.Array):
            yield f"command.{name}", Parameter(path=f"command.{name}", value=value)
    for path, entry in parameters(command).items():
        yield f"command.{path}", _under("command.", entry)
