"""Traces that are kept beside compiled programs: a later process neither traces nor lowers a function again.

JAX's persistent cache keeps what XLA compiled; Python still traces every program of a process anew, which for
a diagnosis takes three times as long as all that it then computes. Where the package keeps compiled programs
(:mod:`jaxmuscle._compilation_cache`) the StableHLO of a trace is kept in the same folder (`jax.export`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import threading
from collections.abc import Callable, Hashable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

import equinox as eqx
import jax
import numpy as np
from jax import export
from jax.core import Tracer

from jaxmuscle import _compilation_cache as programs
from jaxmuscle.errors import InputError
from jaxmuscle.files import atomic_write, package_hash

Given = ParamSpec("Given")
Result = TypeVar("Result")
Compiled = Callable[[list[Any]], Any]

OWN = ("jaxmuscle", "jax", "jaxlib", "numpy", "equinox", "diffrax", "builtins")
"""Packages whose classes and functions are what their names and versions say."""
PLAIN = (type(None), bool, int, float, complex, str, bytes, Enum, np.dtype)
"""Kinds of values that their text tells apart in any process."""
HASH = 32
"""Bytes of the hash with which a kept trace begins."""


class UnknownCodeError(Exception):
    """What a program depends on is not told by names alone: a user's class, a function within a function."""


class KeptProgram(Generic[Given, Result]):
    """A function, compiled as by `equinox.filter_jit`, whose traces are kept for later processes.

    They are where the package keeps programs, and for arguments made of its own classes alone: the code of a
    user's class may be another one next time. Anything else is traced in each process.

    Attributes:
        plain: the function as `equinox.filter_jit` compiles it.
    """

    def __init__(self, function: Callable[Given, Result]) -> None:
        """Wrap a function of a module, whose results are arrays in tuples, lists and dicts."""
        functools.update_wrapper(self, function)
        self.function = function
        self.plain: Callable[Given, Result] = eqx.filter_jit(function)
        self._known: dict[Hashable, Compiled | None] = {}
        self._locks: dict[Hashable, threading.Lock] = {}

    def __call__(self, *args: Given.args, **kwargs: Given.kwargs) -> Result:
        """What the function gives."""
        folder = programs.own_folder(jax)
        if folder is None or kwargs:
            return self.plain(*args, **kwargs)
        leaves, form = jax.tree.flatten(args)
        arrays = [leaf for leaf in leaves if _is_array(leaf)]
        if any(isinstance(each, Tracer) for each in arrays):
            return self.plain(*args, **kwargs)
        still = tuple(None if _is_array(leaf) else (type(leaf), leaf) for leaf in leaves)
        shapes = tuple(jax.typeof(each) for each in arrays)
        key = folder, form, still, shapes, _settings()
        if key not in self._known:
            with self._locks.setdefault(key, threading.Lock()):
                if key not in self._known:
                    self._known[key] = self._program(args, shapes, folder)
        program = self._known[key]
        return self.plain(*args, **kwargs) if program is None else program(arrays)

    def _program(self, args: Any, shapes: tuple[Any, ...], folder: Path) -> Compiled | None:
        """The program for such arguments, its trace found or kept; `None` where it cannot be."""
        try:
            name = _hash([self.__module__, self.function.__qualname__, *_pieces(args)])
        except UnknownCodeError:
            return None
        place = folder / f"{self.function.__name__}-{name}{programs.TRACE}"
        trace = _read(place)
        if trace is None:
            try:
                trace = export.export(jax.jit(self._of_arrays(args)))(list(shapes)).serialize()
            except ValueError:  # an operation that JAX does not promise to keep; or an error, told in `plain`
                return None
            _write(place, bytes(trace))
        call = export.deserialize(bytearray(trace)).call
        return jax.jit(_named(lambda arrays: call(arrays), self.function.__name__))

    def _of_arrays(self, args: Any) -> Callable[[list[Any]], Any]:
        """The function of its arrays alone, all else as in `args`."""
        leaves, form = jax.tree.flatten(args)
        still = [None if _is_array(leaf) else leaf for leaf in leaves]
        places = [i for i, leaf in enumerate(leaves) if _is_array(leaf)]

        def of_arrays(arrays: list[Any]) -> Any:
            whole = list(still)
            for i, each in zip(places, arrays, strict=True):
                whole[i] = each
            return self.function(*jax.tree.unflatten(form, whole))  # pyright: ignore[reportCallIssue]

        return _named(of_arrays, self.function.__name__)


def _named(function: Callable[..., Any], name: str) -> Callable[..., Any]:
    """`function` under the name by which JAX tells of it."""
    function.__name__ = function.__qualname__ = name
    return function


def _is_array(leaf: object) -> bool:
    return isinstance(leaf, jax.Array | np.ndarray | np.generic)


def _settings() -> tuple[Hashable, ...]:
    """What a trace depends on beside arguments and code."""
    names = ("jax_enable_x64", "jax_default_matmul_precision", "jax_numpy_dtype_promotion", "jax_disable_jit")
    return jax.__version__, jax.default_backend(), *(getattr(jax.config, name) for name in names)


def _hash(pieces: list[str]) -> str:
    whole = [package_hash(), eqx.__version__, np.__version__, *map(repr, _settings()), *pieces]
    return hashlib.sha256("\0".join(whole).encode()).hexdigest()


def _pieces(node: Any) -> Iterator[str]:
    """What tells arguments from others for which the trace is another one.

    Raises:
        UnknownCodeError: names do not tell it.
    """
    if _is_array(node):
        yield repr(jax.typeof(node))
    elif isinstance(node, PLAIN):
        yield f"{type(node).__qualname__} {node!r}"
    elif isinstance(node, dict):
        yield _name(type(node))
        for name, value in node.items():
            yield repr(name)
            yield from _pieces(value)
    elif isinstance(node, list | tuple):
        yield f"{_name(type(node))} of {len(node)}"
        for value in node:
            yield from _pieces(value)
    elif isinstance(node, frozenset):
        yield f"{_name(type(node))} of {sorted(piece for value in node for piece in _pieces(value))}"
    elif isinstance(node, functools.partial):
        yield "partial"
        yield from _pieces((node.func, node.args, node.keywords))
    elif isinstance(node, type) or (callable(node) and hasattr(node, "__qualname__")):
        yield _name(node)
    elif dataclasses.is_dataclass(node):
        yield _name(type(node))
        for field in dataclasses.fields(node):
            yield field.name
            yield from _pieces(getattr(node, field.name))
    else:
        raise UnknownCodeError(type(node).__qualname__)


def _name(kind: Any) -> str:
    """Where a class or function of known code is defined."""
    module, name = getattr(kind, "__module__", None) or "", kind.__qualname__
    if module.partition(".")[0] not in OWN or "<" in name:
        raise UnknownCodeError(f"{module}.{name}")
    return f"{module}.{name}"


def _read(place: Path) -> bytes | None:
    """A kept trace, whole; `None` if there is none."""
    with contextlib.suppress(OSError):  # not kept yet, or not for this user: it is traced
        held = place.read_bytes()
        if hashlib.sha256(held[HASH:]).digest() == held[:HASH]:
            return held[HASH:]
    return None


def _write(place: Path, trace: bytes) -> None:
    """Keep a trace, if the folder takes it: without it the next process traces as this one did."""
    with contextlib.suppress(OSError, InputError), atomic_write(place) as (file,):
        file.write_bytes(hashlib.sha256(trace).digest() + trace)
