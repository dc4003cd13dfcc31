"""Offset, discharge coefficient and leak from a static force loop: by gradient, and by downhill simplex."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jet_pipe_rows import actuator
from numpy.typing import NDArray
from published_rows import OWN, Row, aside, near, row
from scipy.optimize import least_squares, minimize

from jaxmuscle.actuators import JetPipeActuator
from jaxmuscle.analysis import equilibrium
from jaxmuscle.parameters import get, replace

PATHS = (
    *("pipe.receiver_offset", "receiver.discharge_coefficient", "cylinder.leak_area", "cylinder.leak_slope"),
)
WRONG = np.array([0.6, 1.25, 0.8, 1.3])
"""Where both begin, in units of the true values."""
NOISE = 0.2
"""Of the force [N]."""
HALF_WIDTH = 0.08e-3
"""Of the tip's hysteresis loop [m], [H] 3.2.1."""
POINTS = 24


class Outcome(NamedTuple):
    """One way of fitting: evaluations, seconds (compiled before), sum of squares [N^2], values found,
    derivatives of the forces by them.
    """

    evaluations: int
    seconds: float
    cost: float
    values: NDArray[np.float64]
    slopes: NDArray[np.float64]

    def deviation(self, weights: NDArray[np.float64]) -> float:
        """Standard deviation of `weights` times the values, where the loop determines it."""
        return float(NOISE * np.sqrt(weights @ np.linalg.pinv(self.slopes.T @ self.slopes) @ weights))


def loop(machine: JetPipeActuator) -> NDArray[np.float64]:
    """Tip positions along the major loop, up and down, as [H] measured them [m]."""
    force = np.linspace(-0.15, 0.6, POINTS)
    middle = np.asarray(machine.pipe.static_position(jnp.asarray(force)))
    return np.concatenate([middle - HALF_WIDTH, middle[::-1] + HALF_WIDTH])


def forces(machine: JetPipeActuator, positions: Any, z: Any) -> Any:
    """Static forces with the tip held at positions, with parameters `z` times those of the actuator."""
    values = {path: get(machine, path) * z[k] for k, path in enumerate(PATHS)}
    offset = values.pop("pipe.receiver_offset")

    def at(position: Any) -> Any:
        held = replace(machine, {**values, "pipe.receiver_offset": position + offset})
        return equilibrium(held, 0.0).readings[1]

    return jax.vmap(at)(positions)


def identified(machine: JetPipeActuator) -> dict[str, Outcome]:
    """Both ways on the same noisy loop, from the same start."""
    positions = jnp.asarray(loop(machine))
    model = jax.jit(lambda z: forces(machine, positions, z))
    slopes = jax.jit(jax.jacfwd(lambda z: forces(machine, positions, z)))
    measured = np.asarray(model(np.ones(4))) + NOISE * np.random.default_rng(0).normal(size=len(positions))
    jax.block_until_ready(slopes(WRONG))

    def left(z: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(model(z)) - measured

    begin = time.perf_counter()
    gradient = least_squares(left, WRONG, jac=lambda z: np.asarray(slopes(z)), x_scale=1.0)  # pyright: ignore
    taken = time.perf_counter() - begin
    evaluations = gradient.nfev + int(gradient.njev or 0)
    found = {"gradient": Outcome(evaluations, taken, 2 * gradient.cost, gradient.x, gradient.jac)}
    begin = time.perf_counter()
    simplex = minimize(
        lambda z: float((left(z) ** 2).sum()), WRONG, method="Nelder-Mead",
        options={"maxfev": 4000, "xatol": 1e-6, "fatol": 1e-6},
    )  # fmt: skip
    taken, end = time.perf_counter() - begin, np.asarray(slopes(simplex.x))
    found["simplex"] = Outcome(simplex.nfev, taken, float(simplex.fun), simplex.x, end)
    return found


def identification_rows() -> Iterator[Row]:
    """Checks of our own: the loop is simulated with the published values, which are to be found again."""
    for entry in compared():
        yield aside(entry, OWN)


def compared() -> Iterator[Row]:
    """What the two ways cost and find."""
    found = identified(actuator())
    gradient, simplex = found["gradient"], found["simplex"]
    for name, way in found.items():
        print(f"    {name}: {way.evaluations} evaluations, {way.seconds:.2f} s, cost {way.cost:.4f} N², "
              f"of the true values {np.round(way.values, 4)}")  # fmt: skip
    source = "[H] 3.3.1"
    ratio = gradient.cost / simplex.cost
    yield row(source, "static loop: sum of squares by gradient over that by simplex", "1 or less", ratio,
              ratio < 1 + 1e-4, "", "1e-4", "the same problem, start and noise")  # fmt: skip
    fewer = simplex.evaluations / gradient.evaluations
    yield row(source, "evaluations of the simplex per evaluation by gradient", "> 1", fewer, fewer > 1, "",
              "above", "the same minimum, a Jacobian counted as one")  # fmt: skip
    offset, discharge, area, slope = (float(v) for v in gradient.values)
    # The weights of a ratio a/C are those of its derivative by C and by a.
    found_rows = (
        ("receiver offset", "mm", 0.099, offset, np.array([1.0, 0, 0, 0])),
        ("leak over C_d, at a ratio of 0", "mm²", 0.0971 / 0.696, area / discharge,
         np.array([0, -area / discharge, 1.0, 0]) / discharge),
        ("fall of the leak over C_d", "mm²", 0.0475 / 0.696, slope / discharge,
         np.array([0, -slope / discharge, 0, 1.0]) / discharge),
    )  # fmt: skip
    for quantity, unit, published, share, weights in found_rows:
        allowed = 3 * gradient.deviation(weights)
        yield near(source, f"{quantity}, found", published, published * share, unit, allowed,
                   "3 standard deviations at a noise of 0.2 N")  # fmt: skip
    yield near(source, "discharge coefficient by itself", 0.696, 0.696 * float(discharge), "", 0.03,
               "noise of 0.2 N",
               "every flow of a static balance is proportional to C_d or to the leak: a static loop "
               "determines their ratio only, whatever the method")  # fmt: skip
