"""Hand-written C, SIMD over the batch and all cores: the limit of what the machine can do."""

from __future__ import annotations

import ctypes
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.polynomial import Chebyshev
from numpy.polynomial.chebyshev import cheb2poly
from peers_build import compiler
from peers_model import COMMAND, CRITICAL, GAMMA, MASS, NAMES, SAMPLES, SHARES, STEP, VALUES, masses

DEGREE, LANES = 17, 16
FLAGS = "-O3 -march=native -fopenmp -ffast-math -mprefer-vector-width=512 -shared -fPIC".split()


def library() -> ctypes.CDLL:
    """Compile and load."""
    found = compiler()
    assert found is not None
    defines = {
        "CRITICAL": CRITICAL,
        "MIDDLE": (1 + CRITICAL) / 2,
        "HALF": (1 - CRITICAL) / 2,
        "DEGREE": DEGREE,
    }
    target = Path(tempfile.mkdtemp()) / "peers.so"
    source = Path(__file__).with_name("peers_c.c")
    given = [f"-D{name}={value!r}" for name, value in defines.items()]
    subprocess.run([found, *FLAGS, *given, str(source), "-o", str(target), "-lm"], check=True)
    return ctypes.CDLL(str(target))


def batch(lib: ctypes.CDLL, runs: int, substeps: int) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
    """A function that makes `runs` runs of different masses: largest positions, positions of the first."""
    padded = -(-runs // LANES) * LANES
    q = np.repeat(VALUES[None, :], padded, axis=0)
    q[:, MASS] = np.resize(masses(runs), padded)
    q = np.concatenate([q, np.sin(q[:, [NAMES.index("angle")]])], axis=1)
    radicand = Chebyshev.interpolate(
        lambda b: b ** (2 / GAMMA) - b ** ((GAMMA + 1) / GAMMA), DEGREE, domain=[CRITICAL, 1.0]
    )
    arrays = [np.ascontiguousarray(a) for a in (COMMAND, q, cheb2poly(radicand.coef), SHARES)]
    top, path = np.zeros(padded), np.zeros(SAMPLES)
    pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*arrays, top, path)]

    def go() -> tuple[np.ndarray, np.ndarray]:
        lib.batch(padded, SAMPLES, substeps, ctypes.c_double(STEP / substeps), *pointers)
        return top[:runs], path

    return go
