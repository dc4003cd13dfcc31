"""What can be swept, by the names that users know it by."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator

import equinox as eqx
import jax
import numpy as np

from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameters import parameters
from jaxmuscle.simulation import Track
from jaxmuscle.sweeps.bench import Bench
from jaxmuscle.sweeps.commands import Function

LOAD = "load."
"""The load of a rig is no component of its own: its parameters stand at the machine."""


@dataclasses.dataclass(frozen=True)
class Leaf:
    """A number or an array of a bench that can be swept.

    Attributes:
        path: dotted path in the :class:`Bench`.
        unit: SI unit.
        meaning: one line.
        shape: empty for a number.
        positive, nonnegative: what its values have to be.
    """

    path: str
    unit: str = ""
    meaning: str = ""
    shape: tuple[int, ...] = ()
    positive: bool = False
    nonnegative: bool = False

    def checked(self, name: str, values: object) -> np.ndarray:
        """`values` as an array with one entry a point along its first axis.

        Raises:
            InputError: another shape, not numbers, not finite, or outside the leaf's range.
        """
        try:
            array = np.asarray(values, dtype=float)
        except (TypeError, ValueError) as error:
            raise InputError(
                f"{name}: expected numbers in {self.unit or 'plain numbers'}: {error}"
            ) from error
        if array.ndim != 1 + len(self.shape) or array.shape[1:] != self.shape or not len(array):
            wanted = "n" + "".join(f", {size}" for size in self.shape)
            raise InputError(f"{name}: expected values of shape ({wanted}); got shape {array.shape}")
        if not np.isfinite(array).all():
            raise InputError(f"{name}: expected finite values; got {array[~np.isfinite(array)][0]}")
        if (self.positive and array.min() <= 0) or (self.nonnegative and array.min() < 0):
            least = "above zero" if self.positive else "zero or more"
            raise InputError(f"{name}: has to be {least}; got {array.min():g} {self.unit}".rstrip())
        return array


def leaf_of(bench: Bench, name: str) -> Leaf:
    """What `name` stands for: a path of the machine, a quantity of its card, ``command.…`` or ``start.…``.

    Raises:
        InputError: an unknown name; the message holds the nearest one.
    """
    known = dict(_leaves(bench))
    if name in known:
        return known[name]
    if name.startswith(LOAD) and name.removeprefix(LOAD) in known:
        return known[name.removeprefix(LOAD)]
    if name.startswith("command.") and not callable(bench.command):
        raise InputError(
            f"cannot sweep {name!r}: the command is a table, which has no parameters; "
            f"give a function of time, such as command=jm.commands.Sine()"
        )
    raise InputError(f"cannot sweep {name!r}{nearest(name, known)}")


def _leaves(bench: Bench) -> Iterator[tuple[str, Leaf]]:
    machine = bench.actuator
    own = dict(_declared(machine, "actuator."))
    yield from own.items()
    for name, path in machine.quantities.items():
        if path in own:
            yield name, own[path]
    if isinstance(bench.command, Track):
        return
    if isinstance(bench.command, eqx.Module):
        units = machine.units
        for name, leaf in _of_command(bench.command):
            unit = re.sub(r"\{(\w+)\}", lambda found: units.get(found[1], found[0]), leaf.unit)
            yield name, dataclasses.replace(leaf, unit=unit)
    for name, value in bench.start.items():
        unit = machine.states[name].unit
        yield f"start.{name}", Leaf(f"start.{name}", unit, f"{name} at the start", np.shape(value))


def _declared(model: eqx.Module, prefix: str) -> Iterator[tuple[str, Leaf]]:
    for path, p in parameters(model).items():
        yield (
            path,
            Leaf(prefix + path, p.unit, p.meaning, np.shape(p.value), bool(p.positive), bool(p.nonnegative)),
        )


def _of_command(command: eqx.Module) -> Iterator[tuple[str, Leaf]]:
    """The parameters of a command; numbers that a user's own module holds undeclared have no unit."""
    if isinstance(command, Function):
        for name, value in command.parameters.items():
            yield f"command.{name}", Leaf(f"command.parameters.{name}", shape=np.shape(value))
        return
    declared = dict(_declared(command, "command."))
    for name, value in vars(command).items():
        if isinstance(value, float | int | np.ndarray | jax.Array):
            yield f"command.{name}", Leaf(f"command.{name}", shape=np.shape(value))
    for path, leaf in declared.items():
        yield f"command.{path}", leaf
