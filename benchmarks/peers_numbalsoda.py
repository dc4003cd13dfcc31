"""numbalsoda: LSODA in C++ called from numba, without Python between the steps, its batches on all cores.

    pip install numbalsoda

It comes as source and needs cmake and a Fortran compiler; where it is not installed its rows are left out.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable

import numba  # pyright: ignore[reportMissingImports]
import numpy as np
import peers_scipy
from numba import carray, cfunc, njit, prange  # pyright: ignore
from peers_model import COMMAND, HOLD, KNOTS, MASS, NAMES, START, STEP, VALUES, masses
from peers_scipy import SCALES

COUNT = len(NAMES)
MOST_STEPS = 10_000
"""Between two samples."""


def available() -> bool:
    """Whether it is installed."""
    return importlib.util.find_spec("numbalsoda") is not None


def solver(cores: int) -> tuple[Callable[[float], np.ndarray], Callable[..., Callable[[], np.ndarray]]]:
    """Tolerance → position at the samples; and runs, tolerance → a function that makes a batch."""
    from numbalsoda import lsoda, lsoda_sig  # pyright: ignore[reportMissingImports]

    rates, scales = peers_scipy.rates, SCALES

    @cfunc(lsoda_sig)
    def field(t, y, dy, given):
        # One absolute tolerance serves all states, so that they are scaled.
        z, out, q = carray(y, (12,)), carray(dy, (12,)), carray(given, (COUNT + 1,))
        rates(z * scales, t, q[COUNT], q[:COUNT], out, False)
        for i in range(12):
            out[i] /= scales[i]

    address = field.address
    times = STEP * np.arange(HOLD + 1)

    @njit
    def path(q, knots, tolerance):
        """Begins anew where the command jumps."""
        y, found = START / scales, np.empty(len(knots) * HOLD)
        given = np.empty(COUNT + 1)
        given[:COUNT] = q
        for k in range(len(knots)):
            given[COUNT] = knots[k]
            states, ended = lsoda(address, y, times, given, tolerance, tolerance, MOST_STEPS)
            if not ended:
                found[:] = np.nan
                return found
            found[k * HOLD : (k + 1) * HOLD] = states[:HOLD, 2] * scales[2]
            y = states[HOLD].copy()
        return found

    @njit(parallel=True)
    def tops(several, knots, tolerance):
        found = np.empty(len(several))
        for i in prange(len(several)):
            found[i] = path(several[i], knots, tolerance).max()
        return found

    numba.set_num_threads(cores)
    knots = np.ascontiguousarray(COMMAND[::HOLD])
    assert len(knots) == len(KNOTS)

    def batch(runs: int, tolerance: float) -> Callable[[], np.ndarray]:
        several = np.repeat(VALUES[None, :], runs, axis=0)
        several[:, MASS] = masses(runs)
        return lambda: tops(several, knots, tolerance)

    return lambda tolerance: path(VALUES, knots, tolerance), batch
