"""The loop of `control_race.problem(6)` in CasADi: cost of a scenario and its gradient by six gains.

Joint 1 of [T] in the package's own fixed steps under its variable-structure controller. As in
`peers_casadi.py` the sensitivities are carried as state and multiplied, stage by stage, by the sparse
derivatives of the rates: forward, since the gains are six. Stops of the joint, which are never reached, and
the slack of muscles are left out.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca  # pyright: ignore[reportMissingImports]
import numpy as np
from numpy.typing import NDArray
from peers_build import caller, quickest
from peers_methods import onward

from jaxmuscle.effects.slip import STICKING_TIME
from jaxmuscle.parameters import get

METHOD = "chebyshev"
OWN, CONTROL = 6, 4
"""States of the machine (angle, its rate, two pressures above P0, their rates) and of the controller."""
Pair = tuple[Any, Any]


class Numbers:
    """Plain numbers of a joint and of a controller by their names; those of the gains apart."""

    def __init__(self, joint: Any, controller: Any, step: float, sizes: dict[str, float]) -> None:
        self.joint = lambda name: float(get(joint, name))
        self.controller = lambda name: float(get(controller, name))
        self.names, self.step, self.sizes = tuple(controller.gains), step, sizes
        self.mean = float(joint.actuation().rest[0]) - float(joint.ambient_pressure)
        self.inertia = float(joint.inertia)
        self.gains = np.array([float(getattr(controller, name)) for name in self.names])


def rates(own: Any, command: Any, inertia: Any, n: Numbers) -> Any:
    """Rates of the machine's states, commands in pressures above P0."""
    angle, speed, pressure, moving = own[0], own[1], own[2:4], own[4:6]
    radius, length, k = (n.joint(name) for name in ("sprocket_radius", "muscle.initial_length", "end_factor"))
    r0, braid = n.joint("initial_radius"), n.joint("braid_angle")
    area, a, b = np.pi * r0**2, 3 / np.tan(braid) ** 2, 1 / np.sin(braid) ** 2
    static, kinetic, fading = (
        n.joint(f"thread_friction.{name}")
        for name in ("static_coefficient", "kinetic_coefficient", "velocity_constant")
    )
    friction = kinetic + (static - kinetic) * ca.exp(-ca.fabs(radius * speed) / fading)
    torque, limit = 0, 0
    for side, own_pressure in ((1, pressure[0]), (-1, pressure[1])):
        gauge = n.mean + own_pressure
        short = 1 - k * (n.joint("initial_contraction") + side * radius * angle / length)
        torque += side * radius * area * gauge * (a * short**2 - b)
        surface = (
            2 * np.pi * r0 * length * np.sin(braid) / (short * ca.sqrt(1 - np.cos(braid) ** 2 * short**2))
        )
        limit += radius * friction * surface * ca.fmax(gauge, 0)
    slip = ca.fmax(-1, ca.fmin((torque + inertia * speed / STICKING_TIME) / limit, 1))
    omega, zeta = 2 * np.pi * n.joint("regulator_frequency"), n.joint("regulator_damping")
    pulled = omega**2 * (command - pressure) - 2 * zeta * omega * moving
    return ca.vertcat(speed, (torque - slip * limit) / inertia, moving, pulled)


def control(state: Any, angle: Any, gains: Any, wanted: Any, n: Numbers) -> Pair:
    """State of the controller after a sample, and its output within the limits of the commands [Pa]."""
    c = {name: gains[i] for i, name in enumerate(n.names)}
    of = n.controller
    error = wanted[0] - angle
    keep = of("smoothing") / (of("smoothing") + n.step)
    rate = keep * state[2] + (1 - keep) * (error - state[1]) / n.step
    second = keep * state[3] + (1 - keep) * (rate - state[2]) / n.step
    near = ca.fabs(error) < of("integral_band")
    grown = state[0] + ca.if_else(near, c["integral_gain"] * n.step * error, 0)
    integral = ca.fmax(-of("integral_limit"), ca.fmin(grown, of("integral_limit")))
    damping, stiffness, gain = (of(f"joint.{name}") for name in ("damping", "stiffness", "gain"))
    held = wanted[2] + damping * wanted[1] + stiffness * wanted[0]
    equivalent = (held - stiffness * error + (c["slope"] - damping) * rate) / gain
    line = rate + c["slope"] * error + c["curvature"] * second
    size = c["per_error"] * ca.fabs(error) + c["per_rate"] * ca.fabs(rate) + c["least"]
    share = ca.fmax(-1, ca.fmin(line / of("boundary"), 1))
    switching = ca.fmax(-of("limit"), ca.fmin(size * share, of("limit")))
    output = ca.fmax(-n.mean, ca.fmin(equivalent + switching + integral, n.mean))
    return ca.vertcat(integral, error, rate, second), output


def carried(function: Any, moving: list[Any], fixed: list[Any]) -> list[Any]:
    """Columns after a function, from columns before: values first, then sensitivities by each gain."""
    found = function(*(each[:, 0] for each in moving), *fixed)
    count = len(found) // (1 + len(moving))
    values, slopes = found[:count], found[count:]
    after = []
    for i, value in enumerate(values):
        own = slopes[i * len(moving) : (i + 1) * len(moving)]
        after.append(
            ca.horzcat(value, sum(slope @ each[:, 1:] for slope, each in zip(own, moving, strict=True)))
        )
    return after


def with_slopes(name: str, values: list[Any], moving: list[Any], fixed: list[Any]) -> Any:
    """A function with its sparse derivatives by what moves."""
    slopes = [ca.jacobian(value, each) for value in values for each in moving]
    return ca.Function(name, [*moving, *fixed], [*values, *slopes])


def sample(n: Numbers) -> tuple[Any, ...]:
    """One sample of the loop, symbolic: columns before, wanted values, noise, inertia; columns after.

    The columns: states of the machine, of the controller, the output of the sample before, the cost so far.
    """
    y, s, u, g = (ca.SX.sym(name, size) for name, size in (("y", OWN), ("s", CONTROL), ("u", 1), ("g", 6)))
    angle, inertia, wanted, noise = ca.SX.sym("angle"), ca.SX.sym("j"), ca.SX.sym("w", 3), ca.SX.sym("n")
    whole, gains = ca.SX.sym("z", OWN + CONTROL + 2, 7), ca.SX.sym("gains", 6)
    rate = with_slopes("rate", [rates(y, ca.vertcat(u, -u), inertia, n)], [y, u], [inertia])
    acting = with_slopes("control", list(control(s, angle, g, wanted, n)), [s, angle, g], [wanted])
    own, before, last, cost = whole[:OWN, :], whole[OWN:-2, :], whole[-2, :], whole[-1, :]
    seen = ca.horzcat(own[0, 0] + noise, own[0, 1:])
    after, output = carried(acting, [before, seen, ca.horzcat(gains, ca.SX.eye(6))], [wanted])
    error, jump = ca.horzcat(wanted[0] - own[0, 0], -own[0, 1:]), output - last
    tracked, varied = (1 / n.sizes[name] ** 2 for name in ("tracking", "variation"))
    # Both commands of a joint jump by as much.
    pairs = ((tracked, error), (varied / n.step**2, jump))
    grown = [w * ca.horzcat(e[0] ** 2, 2 * e[0] * e[1:]) for w, e in pairs]
    moved = onward(METHOD, lambda columns, _: carried(rate, [columns, output], [inertia])[0], own, n.step)
    return whole, wanted, noise, inertia, gains, ca.vertcat(moved, after, output), cost, grown


def cost_with_gradient(n: Numbers, reference: NDArray, base: int) -> Any:
    """Inertia and noise of a scenario, and gains → its cost and the gradient of that by the gains.

    `reference`: angle, velocity, acceleration; a column a sample.
    """
    whole, wanted, noise, inertia, gains, after, cost, (error, jump) = sample(n)
    first = ca.SX.sym("first")
    count = reference.shape[1]
    grown = cost + error / count + (1 - first) * jump / (count - 1)
    packed = ca.vec(ca.densify(ca.vertcat(after, grown)).T)
    step = ca.Function(
        "sample", [ca.vec(whole.T), wanted, noise, first, inertia, gains], [packed], {"cse": True}
    )
    chain = step.mapaccum("chain", count, {"base": base})
    given, seen, values = ca.MX.sym("inertia"), ca.MX.sym("noise", 1, count), ca.MX.sym("gains", 6)
    begin = np.zeros(int(whole.numel()))
    firsts = np.eye(1, count)
    ends = chain(begin, reference, seen, firsts, ca.repmat(given, 1, count), ca.repmat(values, 1, count))
    return ca.Function("loop", [given, seen, values], [ends[-7:, -1]])


def all_costs(
    n: Numbers, reference: NDArray, inertias: NDArray, noise: NDArray, cores: int
) -> Callable[[], NDArray]:
    """Cost and gradient of every scenario, on all cores by CasADi's threads, by its quickest build.

    `noise`: a row a scenario.
    """
    build = quickest(lambda base: cost_with_gradient(n, reference, base), [inertias[0], noise[0], n.gains])
    many = len(inertias)
    given = inertias[None], noise.reshape(1, -1), np.repeat(n.gains[:, None], many, axis=1)
    call = caller(build.function.map(many, "thread", cores), *given)
    return lambda: call()[0]
