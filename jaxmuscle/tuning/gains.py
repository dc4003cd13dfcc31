"""Gains of a controller: which numbers are free, by which names, within which bounds; any `eqx.Module`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.free_parameters import Unknown, Unknowns
from jaxmuscle.estimation.parameter_layout import unknown_within
from jaxmuscle.estimation.request import Bounds, by_name, names, read_bounds
from jaxmuscle.parameter_names import resolve, spelled
from jaxmuscle.parameters import Parameter, entries_of, parameters

SPREAD = 1.5
"""Standard deviation of the logarithm of a positive gain over several starts: a factor of 4.5."""


class Movable(eqx.Module):
    """A controller whose free numbers may be given others; `places`: leaf of each of them, index in it."""

    controller: Any
    places: tuple[tuple[int, tuple[int, ...]], ...] = eqx.field(static=True)

    def at(self, values: Array | Sequence[float]) -> Any:
        """The controller with other values of the free numbers (SI); they may be traced."""
        leaves, form = jax.tree.flatten(self.controller)
        for number, (leaf, index) in enumerate(self.places):
            leaves[leaf] = jnp.asarray(leaves[leaf]).at[index].set(values[number])
        return jax.tree.unflatten(form, leaves)


class Gains(NamedTuple):
    """A controller with free numbers, and what is known of these, in one order.

    A gain that is declared positive, or not negative and begins above zero, is moved on its logarithm, so
    that it keeps its sign; any other in units of its size (:class:`Unknowns`).
    """

    movable: Movable
    unknowns: Unknowns


def gains_of(controller: Any, free: Sequence[str] | None, bounds: Mapping[str, Bounds] | None) -> Gains:
    """The free numbers of a controller.

    Args:
        free: their names: fields ("proportional"), arrays (all entries) or entries ("layers[0].weight[1,2]");
            when `None` those that the class variable `gains` of the controller names, without parameters that
            are zero, by which a part is off; all arrays of a controller without that variable.
        bounds: name → (lower, upper) in SI, `None` on a side without one.

    Raises:
        InputError: an unknown name, nothing free, bounds of what is not free, in the wrong order or without
            the start; a start at zero of which no size is known.
    """
    known, declared = _numbers(controller), _declared(controller)
    usual = getattr(controller, "gains", None)
    asked = (usual or _arrays(known)) if free is None else names(free, "free")
    chosen = list(dict.fromkeys(entry for name in asked for entry in _resolved(known, name, "free")))
    if free is None and usual:
        leaves = jax.tree.leaves(controller)
        # A declared gain of zero is a part that is off; of plain arrays a zero is a value like others.
        off = {n for n in chosen if known[n][2] in declared and leaves[known[n][0]][known[n][1]] == 0}
        chosen = [name for name in chosen if name not in off]
    if not chosen:
        raise InputError(f"{type(controller).__name__} has no number that could be tuned")
    within: dict[str, Bounds] = {}
    for written, pair in by_name(bounds, "bounds").items():
        own = [name for name in _resolved(known, written, "bounds") if name in chosen]
        if not own:
            raise InputError(f"bounds: {written!r} is not free; add it to free= or leave it out of bounds=")
        within |= dict.fromkeys(own, read_bounds(pair, f"bounds[{written!r}]"))
    entries = []
    for name in chosen:
        leaf, index, whole = known[name]
        place = declared.get(whole, Parameter(path=whole, value=0.0))
        array = np.asarray(jax.tree.leaves(controller)[leaf], dtype=float)
        place = dataclasses.replace(place, path=name, name=name, value=float(array[index]))
        entries.append(_unknown(place, within.get(name, (None, None)), array))
    return Gains(movable(controller, chosen), Unknowns(entries))


def movable(controller: Any, chosen: Sequence[str]) -> Movable:
    """A controller of which the numbers of these names are free.

    Raises:
        InputError: it has no number of some name.
    """
    known = _numbers(controller)
    for name in chosen:
        _resolved(known, name, "gains")
    return Movable(controller, tuple(known[name][:2] for name in chosen))


def gain_unit(actuator: AbstractActuator, unit: str, controller: Any = None) -> str:
    """The unit of a gain, in which {input} and {output} are those of a rig's channel.

    On a rig without one they are those that the controller says it `gives` and `reads`.
    """
    channel = actuator.channel
    if channel is not None:
        read, given = actuator.column(actuator.outputs[channel.reading][0]).unit, channel.unit or "1"
    else:
        read, given = (getattr(controller, name, None) for name in ("reads", "gives"))
    if read is None or given is None:
        return unit
    read = f"({read})" if "/" in read else read
    return unit.replace("{input}", given).replace("{output}", read)


Known = dict[str, tuple[int, tuple[int, ...], str]]
"""Name of a number → leaf, index in it, name of the whole leaf."""


def _numbers(controller: Any) -> Known:
    """Every floating number of a controller by its name."""
    found: Known = {}
    for number, (path, leaf) in enumerate(jax.tree_util.tree_flatten_with_path(controller)[0]):
        if not eqx.is_inexact_array(leaf):
            continue
        whole = jax.tree_util.keystr(path).lstrip(".")
        for name, index in zip(entries_of(whole, leaf), np.ndindex(*leaf.shape), strict=True):
            found[name] = number, index, whole
    return found


def _declared(controller: Any, prefix: str = "") -> dict[str, Parameter]:
    """Path → declaration, of controllers in a tuple or list too: ``joints[0].proportional``."""
    if isinstance(controller, tuple | list):
        parts = [(f"{prefix.removesuffix('.')}[{i}].", each) for i, each in enumerate(controller)]
    elif isinstance(controller, eqx.Module):
        fields = [field.name for field in dataclasses.fields(controller)]
        parts = [(f"{prefix}{name}.", getattr(controller, name)) for name in fields]
    else:
        return {}
    own = parameters(controller) if isinstance(controller, eqx.Module) else {}
    found = {prefix + path: place for path, place in own.items()}
    return found | {path: place for part in parts for path, place in _declared(part[1], part[0]).items()}


def _arrays(known: Known) -> list[str]:
    return list(dict.fromkeys(whole for _, _, whole in known.values()))


def _resolved(known: Known, name: str, where: str) -> list[str]:
    """The number of a name, or all those of an array."""
    spellings = spelled({own: own for own in (*_arrays(known), *known)})
    found = resolve(spellings, name, where, "unknown gain {}")
    return [found] if found in known else [entry for entry, (_, _, whole) in known.items() if whole == found]


def _unknown(place: Parameter, bounds: Bounds, whole: Any) -> Unknown:
    """A gain within its bounds, with the size in which it is moved."""
    start, name = float(place.value), place.name
    # Without a rig the unit of a gain may still be a template.
    shown = dataclasses.replace(place, unit="") if "{" in place.unit else place
    entry = unknown_within(name, shown, (0,), start, None, bounds, owner="controller")
    if (place.positive or place.nonnegative) and start > 0:
        moved = dataclasses.replace(place, positive=True)
        return dataclasses.replace(entry, place=moved, scale=SPREAD * start)
    size = abs(start) or (place.typical or 0.0) or (entry.upper if math.isfinite(entry.upper) else 0.0)
    if place.unit or place.meaning:
        if not size:
            raise InputError(
                f"{name} begins at 0, and nothing says how large it may be; begin above it, "
                f"jaxmuscle.replace(controller, {{{name!r}: …}}), or give it an upper bound"
            )
    else:
        # A weight of a network: as large as those beside it.
        size = float(np.sqrt(np.mean(whole**2))) or 1.0
    return dataclasses.replace(entry, place=place, scale=size)
