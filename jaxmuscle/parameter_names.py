"""Names of parameters and their paths, there and back: what cards, fits, sweeps and reports go by.

A parameter of a machine goes by its card's name of it (``"valve_area"``) and by its dotted path
(``"valve.area"``), an entry of an array by the indices behind its path (``"hysteresis.weights[3]"``), a
parameter of an effect by its path with or without the leading ``effects.`` (``"creep.stiffness"``), one that
stands at the machine itself as if it stood at a load, too (``"load.mass"``). The end of a path will do where
only one path ends so (``"area"``). Beside the machine there are the offset of a sensor
(``"offset.position"``) and a state at the first sample of a recording (``"start.opening"``), which have no
other name.

Wherever a name is taken, each of these is right, by :func:`resolve` alone; a card, which is a file that is
edited in place, knows its own names only, and says which. What is printed in a table is always the same
one: the card's name, else the path. It is what an experimenter has written, it is the shortest that cannot
be mistaken, and it can be typed into any argument as it stands. Sentences and pages put it in words
(:func:`~jaxmuscle.formatting.parameter_words`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

from jaxmuscle.errors import UnknownNameError, closest

EFFECTS = "effects."
LOAD = "load."
"""The load of a rig is no component of its own: its parameters stand at the machine."""
OFFSET = "offset."
"""Prefix of the constant that a sensor adds to its column."""
CONSTANT = "constant:"
"""What results put before the name of a quantity of the card that is found to be wrong."""
START = "start."
"""Prefix of a state at the first sample of a recording."""
COMMAND = "command."
"""Prefix of a parameter of the command of a sweep."""
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


def spelled(paths: Mapping[str, str], suffix: str = "") -> dict[str, str]:
    """Every spelling of some parameters → the name that is printed.

    Args:
        paths: name that is printed → path.
        suffix: what stands behind each of them, such as the recording that has it of its own.

    A spelling that is right for two of them stands for the path, then for the name.
    """
    found: dict[str, str] = {}
    for name, path in paths.items():
        found.setdefault(path + suffix, name + suffix)
    for name in paths:
        found.setdefault(name + suffix, name + suffix)
    for name, path in paths.items():
        other = path.removeprefix(EFFECTS) if "." in path else LOAD + path
        found.setdefault(other + suffix, name + suffix)
    return found


def resolve(
    known: Mapping[str, Value], name: str, where: str, unknown: str = "unknown parameter {}"
) -> Value:
    """What `name` stands for: exactly so, or as the end of a single path of the machine.

    Args:
        known: every spelling → what it stands for, either the name that is printed or something that has it
            as its `name`, as :func:`spelled` and :func:`~jaxmuscle.parameters.known_names` give them.
        where: the argument that the name came in, for the message.
        unknown: what is said of a name that stands for nothing, which is put in place of ``{}``.

    Raises:
        UnknownNameError: there is no such parameter, or there are several; the message has the name to write.
    """
    if name in known:
        return known[name]
    ends = {
        _printed(value): value
        for other, value in known.items()
        if other.endswith(f".{name}") and not other.startswith((OFFSET, START, COMMAND))
    }
    if len(ends) > 1:
        raise UnknownNameError(f"{where}: {name!r} may be {' or '.join(map(repr, ends))}; write which")
    if ends:
        return next(iter(ends.values()))
    near = closest(name, known)
    if near is None:
        ends = {other.rpartition(".")[2]: other for other in known}
        near = ends.get(closest(name, ends) or "")
    said = [_printed(value) for value in ([known[near]] if near else known.values())]
    hint = f"did you mean {said[0]!r}?" if near else f"expected one of {', '.join(dict.fromkeys(said))}"
    raise UnknownNameError(f"{where}: {unknown.format(repr(name))}; {hint if said else 'there is none'}")


def _printed(value: object) -> str:
    return str(getattr(value, "name", value))


class ByName(dict[str, Value]):
    """Values by the names that are printed, which are its keys, found by every other spelling too.

    ``fit.values["valve.area"]`` is ``fit.values["valve_area"]``; what is not there raises
    :class:`~jaxmuscle.errors.UnknownNameError`, a `KeyError`, with the nearest name.
    """

    def __init__(self, values: Mapping[str, Value], spellings: Mapping[str, str] | None = None) -> None:
        """Take values by name, and spelling → name of these."""
        super().__init__(values)
        self._spellings = dict(spellings or {})

    def __missing__(self, name: str) -> Value:
        """The value of another spelling of a key."""
        return self[resolve(self._kept, name, "results")]

    def __contains__(self, name: object) -> bool:
        """Whether a spelling stands for a single one of the values."""
        return self._key(name) is not None

    def get(self, name: str, default: Any = None) -> Any:
        """The value of a name, `default` without one."""
        key = self._key(name)
        return default if key is None else self[key]

    @property
    def _kept(self) -> dict[str, str]:
        """Spellings of what is still here."""
        # A view of the keys knows these alone.
        own = {other: name for other, name in self._spellings.items() if name in self.keys()}
        return {**own, **{name: name for name in self}}

    def _key(self, name: object) -> str | None:
        try:
            return resolve(self._kept, name, "results") if isinstance(name, str) else None
        except UnknownNameError:
            return None
