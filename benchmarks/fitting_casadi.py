"""The lifting bench in CasADi: the residuals of both links and their forward sensitivities, compiled as C.

The same equations, clock, windows, weights and steps as the package's fit. A sample is one function of
scalars, chained by `mapaccum`; the sensitivities are carried as state and multiply the sparse derivatives of
each stage, the fastest of what was tried (see `peers_casadi.py`). Residuals and slopes are weighted in the
same C.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from peers_build import OPS, caller, quickest
from peers_methods import onward
from peers_model import GAS, GRAVITY, nozzle

from jaxmuscle._config import cores
from jaxmuscle.estimation.dataset import Station

COUNT = 8
"""Parameters."""
Found = tuple[NDArray[np.float64], NDArray[np.float64]]


class CasadiLift:
    """Residuals and their derivatives by (area, τ, n, r0, k, m, p_supply, d)."""

    def __init__(self, place: Station) -> None:
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
        given = np.array(inputs, dtype=float)
        inside = np.minimum(rows[:, None] + np.arange(problem.samples), count - 1).ravel()
        targets = [np.asarray(problem.targets[name]).reshape(1, -1) for name in names[:2]]
        weights = [np.asarray(problem.weights[name]).reshape(1, -1) for name in names[:2]]
        step = self._sample(float(track.step), problem.substeps)

        def whole(base: int) -> Any:
            p = ca.MX.sym("p", COUNT)
            chain = step.mapaccum("chain", count, {"base": base})
            out = chain(np.zeros(4 * (1 + COUNT)), given, ca.repmat(p, 1, count))[1]
            residuals, slopes = [], []
            for first, target, weight in zip((0, 1 + COUNT), targets, weights, strict=True):
                read = out[first : first + 1 + COUNT, inside.tolist()]
                residuals.append((read[0, :] - target) * weight)
                slopes.append(read[1:, :] * np.repeat(weight, COUNT, axis=0))
            return ca.Function("lift", [p], [ca.horzcat(*residuals), ca.horzcat(*slopes)])

        build = quickest(whole, [np.ones(COUNT)])
        self.function, self.calls = build.function, {}

    def __call__(self, values: NDArray[np.float64]) -> Found:
        return self.several(values[None])[0]

    def several(self, points: NDArray[np.float64]) -> list[Found]:
        """At several points at once, on all cores; what is given back stands until the next call."""
        number = len(points)
        if number not in self.calls:
            function = self.function if number == 1 else self.function.map(number, "thread", cores())
            taken = np.zeros((number, COUNT))
            self.calls[number] = (taken, caller(function, taken.T))
        taken, call = self.calls[number]
        taken[:] = points
        r, slopes = call()
        return list(
            zip(r.ravel(order="F").reshape(number, -1), slopes.T.reshape(number, -1, COUNT), strict=True)
        )

    def _sample(self, h: float, substeps: int) -> Any:
        """State and sensitivities of a sample → those of the next one, and the readings with theirs."""
        whole, given, p = ca.SX.sym("z", 4, 1 + COUNT), ca.SX.sym("u", 8), ca.SX.sym("p", COUNT)
        x, now = ca.SX.sym("x", 4), ca.SX.sym("now", 4)
        rising = self._rates(x, now[0], now[1:], p)
        rate = ca.Function("rate", [x, now, p], [rising, ca.jacobian(rising, x), ca.jacobian(rising, p)])

        def at(y: Any, part: float) -> Any:
            known = ca.vertcat(given[0], given[2:5] + part * (given[5:8] - given[2:5]))
            value, by_x, by_p = rate(y[:, 0], known, p)
            return ca.horzcat(value, by_x @ y[:, 1:] + by_p)

        # Opening runs on; pressure, position and velocity are as measured where a window begins.
        again = ca.horzcat(given[2:5], ca.SX(3, COUNT))
        begun = ca.vertcat(whole[0, :], ca.if_else(given[1] > 0, again, whole[1:, :]))
        after = begun
        for place in range(substeps):
            part = lambda y, node, k=place: at(y, (k + node) / substeps)  # noqa: E731
            end = onward("chebyshev", part, after, h / substeps)
            down, falling = end[2, 0] <= 0, ca.logic_and(end[2, 0] <= 0, end[3, 0] < 0)
            landed = ca.vertcat(ca.if_else(down, 0, end[2, :]), ca.if_else(falling, 0, end[3, :]))
            after = ca.vertcat(end[:2, :], landed)
        read = ca.vertcat(begun[1, :].T, begun[2, :].T)
        packed = [ca.vec(whole.T), given, p]
        return ca.Function("sample", packed, [ca.densify(ca.vec(after.T)), ca.densify(read)], {"cse": True})

    def _rates(self, state: Any, command: Any, measured: Any, p: Any) -> Any:
        """Each link with its measured inputs: pressure from the motion, motion from the pressure."""
        area, tau, n, r0, k, mass, supply, damping = ca.vertsplit(p)
        c, (opening, pressure, x, v) = self.card, ca.vertsplit(state)
        temperature, ambient, l0, alpha = (c["gas_temperature"], c["ambient_pressure"], c["initial_length"],
                                           c["braid_angle"])  # fmt: skip
        charging = opening >= 0
        source, sink = ca.if_else(charging, supply, pressure), ca.if_else(charging, pressure, ambient)
        flow = nozzle(area * opening, source, sink, temperature, OPS)
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
