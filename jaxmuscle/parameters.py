"""Parameters with a unit and a meaning, and the tools that read and replace them by name.

Every number of a model is a float64 array leaf declared with :func:`parameter`. Nothing else in the
package knows the concrete parameters: fitting, sweeps, cards and reports go through :func:`parameters`,
:func:`get` and :func:`replace`, which address a leaf by its dotted path (``"muscle.end_factor"``,
``"effects.creep.strength"``), an entry of an array by its indices (``"hysteresis.weights[3]"``), and either
by any other name (:mod:`jaxmuscle.parameter_names`).
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar, get_type_hints

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float

from jaxmuscle.errors import InputError, UnknownNameError
from jaxmuscle.formatting import declared
from jaxmuscle.parameter_names import card_name, resolve, spelled

Scalar = Float[Array, ""]

_REQUIRED = dataclasses.MISSING
_INDEXED = re.compile(r"(?P<path>.+)\[(?P<index>[\d,]+)\]")
LISTED = 6
"""Entries of an array that are printed; of a longer one its shape is told."""
Model = TypeVar("Model", bound=eqx.Module)


def parameter(
    unit: str,
    meaning: str,
    *,
    default: Any = _REQUIRED,
    positive: bool = False,
    nonnegative: bool = False,
    typical: float | Mapping[str, float] | None = None,
) -> Any:
    """Declare a field of a model as a parameter.

    Args:
        unit: SI unit as pint reads it; ``{load}`` and ``{motion}`` stand for the units of the load and
            of its position in the rig at hand (N and m, or N m and rad), ``{column force}`` and
            ``{rate force}`` for those of a column and of its rate.
        meaning: one line in the words of the field.
        default: value when none is given.
        positive: kept above zero by every fit.
        nonnegative: may be zero, never below, in every fit.
        typical: natural size (SI) of a parameter whose default is zero: how far a fit may well move it.
            By unit, ``{"V": 0.1, "Pa": 1e3}``, where that depends on the rig.
    """
    return eqx.field(
        converter=lambda value: _numbers(value, meaning, unit),
        default=default,
        metadata={
            "unit": unit,
            "meaning": meaning,
            "positive": positive,
            "nonnegative": nonnegative,
            "typical": typical,
        },
    )


@dataclasses.dataclass(frozen=True)
class Declaration:
    """What :func:`parameter` says of a parameter, in the units of a rig.

    Attributes:
        unit: SI unit.
        meaning: one line in the words of the field.
        positive: above zero in every fit.
        nonnegative: zero or above in every fit.
        typical: natural size (SI) of one whose value is zero: how far a fit may well move it.
    """

    unit: str = ""
    meaning: str = ""
    positive: bool = False
    nonnegative: bool = False
    typical: float | None = None

    @classmethod
    def of(cls, field: dataclasses.Field[Any], units: Mapping[str, str]) -> Declaration:
        """What a field declares; a unit of the rig that `units` does not hold stays as it is written."""
        said = {each.name: field.metadata[each.name] for each in dataclasses.fields(Declaration)}
        unit, typical = said["unit"].format_map(_Units(units)), said["typical"]
        typical = typical.get(unit) if isinstance(typical, Mapping) else typical
        return Declaration(**{**said, "unit": unit, "typical": typical})


@dataclasses.dataclass(frozen=True, kw_only=True)
class Parameter(Declaration):
    """One parameter of a machine, or an entry of one that is an array; what beside a machine can be fitted.

    Attributes:
        path: dotted path in the machine, ``offset.COLUMN`` or ``start.STATE``
            (:mod:`jaxmuscle.parameter_names`).
        value: a number or an array (SI).
        name: what cards and results call it: the card's name of a quantity, else its path.
    """

    path: str
    value: Any
    name: str = ""

    def __post_init__(self) -> None:
        """Without another name it goes by its path."""
        if not self.name:
            object.__setattr__(self, "name", self.path)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of an array; empty for a number."""
        return jnp.shape(self.value)

    @property
    def printed(self) -> str:
        """The value as people write it, in a unit of the right size: ``1.2 mm²``."""
        entries = np.asarray(self.value)
        if not np.issubdtype(entries.dtype, np.number):
            return str(self.value)
        if entries.size > LISTED:
            return f"{' × '.join(map(str, entries.shape))} numbers"
        # Without a rig a unit may still be a template.
        unit = "" if "{" in self.unit else self.unit
        return ", ".join(declared(float(each), unit) for each in entries.ravel())


def parameters(model: eqx.Module) -> dict[str, Parameter]:
    """Every parameter of `model` by its dotted path, in the order of declaration."""
    units = getattr(model, "unit_templates", getattr(model, "units", {}))
    return {entry.path: entry for entry in _walk(model, "", units)}


def known_names(model: eqx.Module) -> dict[str, Parameter]:
    """Every parameter of a model, and every entry of those that are arrays, by all of its names."""
    found: dict[str, Parameter] = {}
    quantities = getattr(model, "quantities", {})
    for path, whole in parameters(model).items():
        for own in dict.fromkeys((path, *entries_of(path, whole.value))):
            value, name = get(model, own), card_name(quantities, own)
            value = float(value) if jnp.ndim(value) == 0 else value
            found[name] = dataclasses.replace(whole, path=own, name=name, value=value)
    return {other: found[name] for other, name in spelled({n: p.path for n, p in found.items()}).items()}


def expanded(known: Mapping[str, Parameter], parameter: Parameter) -> list[Parameter]:
    """The parameter itself, or all entries of an array."""
    return [known[path] for path in entries_of(parameter.path, parameter.value)]


def describe(model: eqx.Module) -> pd.DataFrame:
    """A table of every parameter of `model`, to be read: name, value, SI unit, path, meaning.

    The rows go by the card's names, by the path where cards have no name; name and path are both right in
    every argument that takes one. `value` is a text in a unit of the right size, ``1.2 mm²``. Arguments are
    numbers in `SI unit`; :func:`get` and :func:`parameters` give them.
    """
    quantities = getattr(model, "quantities", {})
    rows = [
        (card_name(quantities, path), entry.printed, entry.unit, path, entry.meaning)
        for path, entry in parameters(model).items()
    ]
    return pd.DataFrame(rows, columns=["name", "value", "SI unit", "path", "meaning"]).set_index("name")


def get(model: eqx.Module, name: str) -> Any:
    """The value of a parameter, or of an entry of one, by its path or any other name (SI).

    Raises:
        UnknownNameError: there is no such parameter; the message has the nearest name.
    """
    return _at(model, path_of(model, name, "get"))


def path_of(model: eqx.Module, name: str, where: str) -> str:
    """The path of what `name` stands for in a model, by :func:`~jaxmuscle.parameter_names.resolve`.

    Args:
        where: the function that the name was given to, for the message.
    """
    written, index = split_index(name)
    leaf = written
    if _at(model, leaf) is _REQUIRED:
        quantities = getattr(model, "quantities", {})
        paths = {card_name(quantities, path): path for path in parameters(model)}
        leaf = paths[resolve(spelled(paths), leaf, where)]
    if index is None:
        return leaf
    shape = jnp.shape(_at(model, leaf))
    if len(index) != len(shape) or any(i >= n for i, n in zip(index, shape, strict=True)):
        raise UnknownNameError(f"{where}: no parameter {name!r}: {leaf} has shape {shape}")
    return leaf + name.removeprefix(written)


def split_index(path: str) -> tuple[str, tuple[int, ...] | None]:
    """``"a.b[1,2]"`` as ``("a.b", (1, 2))``; `None` for a whole leaf."""
    found = _INDEXED.fullmatch(path)
    if found is None:
        return path, None
    return found["path"], tuple(int(i) for i in found["index"].split(","))


def entries_of(path: str, value: Any) -> list[str]:
    """The paths of all entries of an array at a path; the path itself for a single number."""
    if jnp.ndim(value) == 0:
        return [path]
    return [f"{path}[{','.join(map(str, index))}]" for index in np.ndindex(*jnp.shape(value))]


def replace(model: Model, values: Mapping[str, Any]) -> Model:
    """A copy of `model` with other values of parameters, or of entries of arrays.

    Args:
        values: name → number or array, in SI. A name is a path or any other name of the parameter,
            ``"valve.area"`` or ``"valve_area"`` (:mod:`jaxmuscle.parameter_names`).

    Raises:
        UnknownNameError: there is no such parameter; the message has the nearest name.
        InputError: one parameter is given twice, or a text in place of a number.
    """
    found: dict[str, Any] = {}
    for name, value in values.items():
        path = path_of(model, name, "replace")
        if path in found:
            raise InputError(f"replace: {name!r} is given twice, also by another name; keep one")
        if isinstance(value, str):
            unit = parameters(model)[split_index(path)[0]].unit
            raise InputError(f"replace: {name!r}: expected a number in SI [{unit or '1'}]; got {value!r}")
        found[path] = value
    whole = _whole_leaves(model, found)
    return eqx.tree_at(
        lambda m: [_at(m, path) for path in whole],
        model,
        [jnp.asarray(value, dtype=float) for value in whole.values()],
    )


def raised(model: Model, values: Mapping[str, Any]) -> Model:
    """A copy of `model` with parameters that are larger by the given amounts; itself without any.

    Args:
        values: path → number or array, in SI.
    """
    return replace(model, {path: get(model, path) + by for path, by in values.items()}) if values else model


def _whole_leaves(model: eqx.Module, values: Mapping[str, Any]) -> dict[str, Any]:
    """`values` with the entries of each array put together."""
    whole = {path: value for path, value in values.items() if split_index(path)[1] is None}
    parts: dict[str, dict[tuple[int, ...], Any]] = {}
    for path in values:
        leaf, index = split_index(path)
        if index is not None:
            parts.setdefault(leaf, {})[index] = values[path]
    for leaf, entries in parts.items():
        at = tuple(jnp.asarray(axis) for axis in zip(*entries, strict=True))
        base = jnp.asarray(whole.get(leaf, get(model, leaf)), dtype=float)
        whole[leaf] = base.at[at].set(jnp.stack([jnp.asarray(v, dtype=float) for v in entries.values()]))
    return whole


def declared_at(kind: type[Any], path: str) -> dataclasses.Field[Any]:
    """The field of a class of models that declares the parameter at a dotted path."""
    *components, name = path.split(".")
    for component in components:
        kind = get_type_hints(kind)[component]
    return {field.name: field for field in dataclasses.fields(kind)}[name]


def _at(model: eqx.Module, path: str) -> Any:
    """What stands at a path; `_REQUIRED` if there is nothing."""
    leaf, index = split_index(path)
    node: Any = model
    for name in leaf.split("."):
        node = node.get(name, _REQUIRED) if isinstance(node, Mapping) else getattr(node, name, _REQUIRED)
    return node if index is None else node[index]


def _walk(node: Any, prefix: str, units: Mapping[str, str]) -> Iterator[Parameter]:
    if isinstance(node, Mapping):
        for name, child in node.items():
            if isinstance(child, eqx.Module | Mapping):
                yield from _walk(child, f"{prefix}{name}.", units)
        return
    for field in dataclasses.fields(node):
        child = getattr(node, field.name)
        if "unit" in field.metadata:
            said = vars(Declaration.of(field, units))
            yield Parameter(path=prefix + field.name, value=child, **said)
        elif isinstance(child, eqx.Module | Mapping):
            yield from _walk(child, f"{prefix}{field.name}.", units)


class _Units(dict[str, str]):
    """Units of a rig; a template without a rig stays as it is."""

    def __missing__(self, key: str) -> str:
        return "{" + key + "}"


def _numbers(value: Any, meaning: str, unit: str) -> Any:
    """An array of floating-point numbers; `InputError` for what is none."""
    try:
        return jnp.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        wanted = f"a number or an array of numbers [{unit or '1'}]"
        raise InputError(f"{meaning}: expected {wanted}; got {type(value).__name__}: {error}") from error
