"""The lifting bench in CasADi: the residuals of both links and their forward sensitivities.

The same equations, clock, windows and weights as the package's fit; one classical Runge-Kutta step a sample
(four stages, as the package's own method). State and sensitivities run through one expanded function that is
mapped over the samples, which was the fastest of what was tried.
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from jaxmuscle.estimation.stations import Station

GAMMA, GAS, GRAVITY, LAMINAR = 1.4, 287.0, 9.80665, 0.999
CRITICAL = (2 / (GAMMA + 1)) ** (GAMMA / (GAMMA - 1))


def nozzle(area: Any, one: Any, other: Any, temperature: float) -> Any:
    """[H] 2.18-2.22 with a laminar chord beside equal pressures."""
    up, down = ca.fmax(one, other), ca.fmin(one, other)
    ratio = down / up
    inside = ca.fmin(ca.fmax(ratio, CRITICAL), LAMINAR)
    root = ca.sqrt(inside ** (2 / GAMMA) - inside ** ((GAMMA + 1) / GAMMA))
    chord = ca.fmin((1 - ratio) / (1 - LAMINAR), 1.0)
    size = area * up * np.sqrt(2 * GAMMA / ((GAMMA - 1) * GAS * temperature)) * root * chord
    return ca.sign(one - other) * size


class CasadiLift:
    """Residuals and their derivatives by (area, τ, n, r0, k, m, p_supply, d); `seconds`: time to build it."""

    def __init__(self, place: Station, compiled: bool) -> None:
        begin = time.perf_counter()
        machine, problem, track = place.actuator, place.problem, place.problem.track
        self.card = {n: float(_at(machine, p)) for n, p in machine.quantities.items()}
        rows, period = np.asarray(problem.rows), int(problem.period)
        measured = {n: np.asarray(v) for n, v in track.measured.items()}
        command, count = np.asarray(track.command), len(track.command)
        later = lambda v: np.append(v[1:], v[-1])  # noqa: E731
        names = ("pressure", "position", "velocity")
        restart = np.isin(np.arange(count), (rows[:, None] + np.arange(0, problem.samples, period)).ravel())
        # A window that is longer than its recording goes on beyond it; its readings have no weight.
        inputs = [command, restart, *(measured[n] for n in names), *(later(measured[n]) for n in names)]
        self.inputs = np.array(inputs, dtype=float)
        at = rows[:, None] + np.arange(problem.samples)
        inside, of = np.minimum(at, count - 1), lambda table: np.asarray(table)
        self.parts = [(of(problem.targets[o]), of(problem.weights[o]), inside) for o in names[:2]]
        step = self._step(float(track.step))
        self.run = step.mapaccum("run", count)
        if compiled:
            flags = {"compiler": "shell", "jit": True, "jit_options": {"flags": ["-O3", "-march=native"]}}
            looped = step.mapaccum("looped", count, {"base": 1000})
            x, p, u = ca.MX.sym("x", 4 * 9), ca.MX.sym("p", 8), ca.MX.sym("u", len(inputs), count)
            # CasADi leaves its sources and objects where it runs.
            with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
                self.run = ca.Function("whole", [x, u, p], list(looped(x, u, ca.repmat(p, 1, count))), flags)
        self.compiled = compiled
        self.seconds = time.perf_counter() - begin

    def __call__(self, values: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
        begin = np.zeros(36)
        p = values if self.compiled else np.repeat(values[:, None], self.inputs.shape[1], axis=1)
        out = np.asarray(self.run(begin, self.inputs, p)[1])
        both = (out[0:9], out[9:18])
        r, slopes = [], []
        for (target, weight, at), table in zip(self.parts, both, strict=True):
            r.append(((table[0][at] - target) * weight).ravel())
            slopes.append((table[1:, at] * weight).reshape(8, -1))
        return np.concatenate(r), np.concatenate(slopes, axis=1).T

    def _step(self, h: float) -> Any:
        """State and sensitivities of a sample → those of the next one, and the readings with theirs."""
        p, state, given = ca.SX.sym("p", 8), ca.SX.sym("x", 4), ca.SX.sym("u", 8)
        sens = ca.SX.sym("s", 4, 8)
        begun = self._begun(state, given)
        after = self._after(begun, given, p, h)
        first = ca.mtimes(ca.jacobian(begun, state), sens)
        total = ca.mtimes(
            ca.substitute(ca.jacobian(self._after(state, given, p, h), state), state, begun), first
        )
        total += ca.jacobian(self._after(begun, given, p, h), p)
        read = ca.vertcat(begun[1], first[1, :].T, begun[2], first[2, :].T)
        packed = ca.vertcat(state, ca.vec(sens))
        return ca.Function(
            "step", [packed, given, p], [ca.vertcat(after, ca.vec(total)), read], {"cse": True}
        )

    def _begun(self, state: Any, given: Any) -> Any:
        """Opening runs on; pressure, position and velocity are as measured where a window begins."""
        again = [ca.if_else(given[1] > 0, given[2 + i], state[1 + i]) for i in range(3)]
        return ca.vertcat(state[0], *again)

    def _after(self, state: Any, given: Any, p: Any, h: float) -> Any:
        rates = lambda x, f: self._rates(x, given[0], given[2:5] + f * (given[5:8] - given[2:5]), p)  # noqa: E731
        one = rates(state, 0.0)
        two = rates(state + h / 2 * one, 0.5)
        three = rates(state + h / 2 * two, 0.5)
        end = state + h / 6 * (one + 2 * two + 2 * three + rates(state + h * three, 1.0))
        down = end[2] <= 0
        return ca.vertcat(
            end[0], end[1], ca.if_else(down, 0, end[2]), ca.if_else(down, ca.fmax(end[3], 0), end[3])
        )

    def _rates(self, state: Any, command: Any, measured: Any, p: Any) -> Any:
        """Each link with its measured inputs: pressure from the motion, motion from the pressure."""
        area, tau, n, r0, k, mass, supply, damping = ca.vertsplit(p)
        c, (opening, pressure, x, v) = self.card, ca.vertsplit(state)
        temperature, ambient, l0, alpha = (c["gas_temperature"], c["ambient_pressure"], c["initial_length"],
                                           c["braid_angle"])  # fmt: skip
        flow = nozzle(area * ca.fmax(opening, 0), supply, pressure, temperature)
        flow -= nozzle(area * ca.fmax(-opening, 0), pressure, ambient, temperature)
        ratio, cos2 = 1 - measured[1] / l0, np.cos(alpha) ** 2
        base = np.pi * r0**2 / np.sin(alpha) ** 2
        volume, slope = base * l0 * ratio * (1 - cos2 * ratio**2), -base * (1 - 3 * cos2 * ratio**2)
        speed = ca.if_else(measured[1] <= 0, ca.fmax(measured[2], 0), measured[2])
        rising = n * (GAS * temperature * flow - pressure * slope * speed) / volume
        shape = 3 / np.tan(alpha) ** 2 * (1 - k * x / l0) ** 2 - 1 / np.sin(alpha) ** 2
        load = np.pi * r0**2 * (measured[0] - ambient) * shape - mass * GRAVITY - damping * v
        held = ca.logic_and(x <= 0, load < 0)
        return ca.vertcat(
            (command / c["full_command"] - opening) / tau, rising, v, ca.if_else(held, 0, load / mass)
        )


def _at(machine: Any, path: str) -> Any:
    for name in path.split("."):
        machine = getattr(machine, name)
    return machine
