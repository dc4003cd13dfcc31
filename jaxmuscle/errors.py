"""Errors that the user can mend, and what their messages are made of."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager


class InputError(ValueError):
    """The user's input is at fault: the message says what was expected, what came and what to do."""


class NoFitError(InputError):
    """No start of a fit led anywhere: predictions are not numbers, or the solver gave up."""


class UnknownNameError(InputError, KeyError):
    """There is nothing of that name; a `KeyError` too, for those who look something up by name."""

    def __str__(self) -> str:
        """The message as it is, which a `KeyError` would put in quotes."""
        return str(self.args[0])


class Problems:
    """The faults of one file, told together: the user mends them in one go."""

    def __init__(self, file: object) -> None:
        """Start without a fault; `file` begins the message."""
        self.file = file
        self.found: list[str] = []

    def add(self, where: str, message: str) -> None:
        """Note a fault at a place in the file."""
        self.found.append(f"{where}: {message}")

    @contextmanager
    def at(self, where: str) -> Iterator[None]:
        """Note the `InputError` that is raised inside as a fault at a place, and go on."""
        try:
            yield
        except InputError as error:
            self.add(where, str(error))

    def check(self) -> None:
        """Raise one `InputError` with everything noted, if anything was."""
        if len(self.found) == 1:
            raise InputError(f"{self.file}: {self.found[0]}")
        if self.found:
            lines = "".join(f"\n  - {problem}" for problem in self.found)
            raise InputError(f"{self.file}: {len(self.found)} problems{lines}")


def nearest(name: str, options: Iterable[str], *, all_if_none_near: bool = True) -> str:
    """The end of a message about an unknown name: the nearest option, else all of them (or nothing)."""
    options = list(options)
    if (near := closest(name, options)) is not None:
        return f"; did you mean {near!r}?"
    if not all_if_none_near:
        return ""
    return f"; expected one of {', '.join(options)}" if options else "; there is none"


def nearest_or_own(name: str, options: Iterable[str], register: str) -> str:
    """The same where users may have made the option themselves, which `register` makes known."""
    near = nearest(name, options)
    stop = "" if near.endswith("?") else "."
    return f"{near}{stop} Is it your own? Then {register} it"


def closest(name: str, options: Iterable[str]) -> str | None:
    """The option that is most like a name, if one is like it."""
    by_lower = {option.lower(): option for option in options}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return by_lower[near[0]] if near else None
