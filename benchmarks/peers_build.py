"""CasADi's functions as C: written out, compiled in several ways, called without copying what they take."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import shutil
import subprocess
import tempfile
import time
import types
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import casadi as ca  # pyright: ignore[reportMissingImports]
import numpy as np

OPS = types.SimpleNamespace(
    where=ca.if_else, exp=ca.exp, sqrt=ca.sqrt, maximum=ca.fmax, minimum=ca.fmin, sin=ca.sin, cos=ca.cos
)
"""CasADi's functions by the names that the model uses."""
# In C89 CasADi writes a maximum as a comparison, which is one instruction; fmax of C99 is a call.
PLAIN = ("-march=native", "-std=gnu89", "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared")
LEVELS = ("-O2", "-O3")
"""XLA keeps to IEEE arithmetic, and so do these: no -ffast-math on either side."""
BASES = (10, 32)
"""Calls that one level of a nested `mapaccum` makes: 10 unless one asks, or the root of the steps."""


def compiler() -> str | None:
    """The C compiler of this machine."""
    return shutil.which("gcc") or shutil.which("cc") or shutil.which("clang")


def built(function: Any, level: str) -> Any:
    """The function as a shared library."""
    found = compiler()
    assert found is not None
    folder, name = tempfile.mkdtemp(), function.name()
    # CasADi writes its sources where it runs.
    with contextlib.chdir(folder):
        function.generate(f"{name}.c")
        subprocess.run([found, level, *PLAIN, f"{name}.c", "-o", f"{name}.so", "-lm"], check=True)
    return ca.external(name, str(Path(folder) / f"{name}.so"))


def caller(function: Any, *given: Any) -> Callable[[], list[np.ndarray]]:
    """A call on buffers that stay where they are: CasADi's way without a copy.

    What is `given` as contiguous doubles, column by column, is read where it lies at every call.
    """
    buffer, trigger = function.buffer()
    taken = [np.ascontiguousarray(np.ravel(value, order="F"), dtype=float) for value in given]
    made = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    for place, value in enumerate(taken):
        buffer.set_arg(place, value.data)
    for place, value in enumerate(made):
        buffer.set_res(place, value.data)
    shapes = [function.size_out(i) for i in range(function.n_out())]

    def call(keep: Any = (buffer, taken)) -> list[np.ndarray]:
        trigger()
        return [value.reshape(shape, order="F") for value, shape in zip(made, shapes, strict=True)]

    return call


@dataclasses.dataclass(frozen=True)
class Build:
    """A compiled function and its call with what it was given."""

    function: Any
    call: Callable[[], list[np.ndarray]]


def quickest(make: Callable[[int], Any], given: Iterable[Any]) -> Build:
    """The fastest of the builds: `make(base)` for every base, at every level of the compiler."""
    found: list[tuple[float, int, Build]] = []
    for base, level in itertools.product(BASES, LEVELS):
        function = built(make(base), level)
        call, times = caller(function, *given), []
        for _ in range(20):
            begin = time.perf_counter()
            call()
            times.append(time.perf_counter() - begin)
        found.append((min(times), len(found), Build(function, call)))
    return min(found)[-1]
