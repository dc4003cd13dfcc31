"""CasADi in the package's own fixed steps: one run, a batch, its Jacobian and its gradient, compiled as C.

A sample is one function of scalars, chained over the samples by `mapaccum`. The Jacobian carries the
sensitivities as state and multiplies them, stage by stage, by the sparse derivatives of the rates: a third of
the time of `forward(12)` or of tangents through the whole sample. The gradient runs backward over the stored
states.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca  # pyright: ignore[reportMissingImports]
import numpy as np
from peers_build import OPS, caller, quickest
from peers_methods import onward
from peers_model import (
    COMMAND,
    FREE,
    MASS,
    NAMES,
    SAMPLES,
    START,
    START_SLOPES,
    STEP,
    VALUES,
    landed,
    masses,
    own_rates,
)

STEPS = SAMPLES - 1
ANGLE = NAMES.index("angle")
LEVEL_SAMPLES = 10
GIVEN = (COMMAND[:STEPS], VALUES)
"""What a run takes."""
Steps = tuple[str, int]


def pieces() -> tuple[Any, Any]:
    """Rates and the end of a step, each with its sparse derivatives by states, plays and parameters."""
    y, f, u, q = ca.SX.sym("y", 4), ca.SX.sym("f", 8), ca.SX.sym("u"), ca.SX.sym("q", len(NAMES) + 2)
    known = ca.vertsplit(q)
    own, plays = ca.vertsplit(y), ca.vertsplit(f)
    moved = landed(own, plays, known[4], OPS)[1]
    rate = ca.vertcat(*own_rates(own, moved, u, known[:-2], OPS, known[-2:]))
    ended = landed(own, plays, known[4], OPS)
    end = ca.vertcat(*ended[0], *ended[1])
    return tuple(
        ca.Function(name, [y, f, u, q], [value, *(ca.jacobian(value, by) for by in (y, f, q))])
        for name, value in (("rate", rate), ("end", end))
    )  # pyright: ignore[reportReturnType]


def sample(steps: Steps, directions: int) -> tuple[Any, Any, Any, Any]:
    """One sample: columns of state and sensitivities before, command, parameters; the columns after."""
    whole, u, q = ca.SX.sym("z", 12, 1 + directions), ca.SX.sym("u"), ca.SX.sym("q", len(NAMES) + 2)
    rate, end = pieces()
    # The braid angle is not free: its sine and cosine, the last two parameters, have no derivatives.
    seeds = ca.SX(len(NAMES) + 2, directions)
    for column, place in enumerate(FREE[:directions]):
        seeds[place, column] = 1

    def carried(function: Any, y: Any, f: Any) -> Any:
        value, by_y, by_f, by_q = function(y[:, 0], f[:, 0], u, q)
        return ca.horzcat(value, by_y @ y[:, 1:] + by_f @ f[:, 1:] + by_q @ seeds)

    after, (method, substeps) = whole, steps
    for _ in range(substeps):
        plays = after[4:, :]
        own = onward(method, lambda y, _, f=plays: carried(rate, y, f), after[:4, :], STEP / substeps)
        after = carried(end, own, plays)
    return whole, u, q, ca.densify(after)


def chain(steps: Steps, directions: int, base: int) -> Any:
    """All samples: packed columns, commands, parameters → columns after each sample, and their positions."""
    whole, u, q, after = sample(steps, directions)
    # Row by row, so that the sensitivities of one state lie side by side.
    step = ca.Function("sample", [ca.vec(whole.T), u, q], [ca.vec(after.T), after[2, :].T], {"cse": True})
    return step.mapaccum(f"chain{directions}", STEPS, {"base": base})


def symbols() -> tuple[Any, Any, Any]:
    """Commands, parameters, and parameters with sine and cosine of the angle, for every sample."""
    u, q = ca.MX.sym("u", 1, STEPS), ca.MX.sym("q", len(NAMES))
    return u, q, ca.repmat(ca.vertcat(q, ca.sin(q[ANGLE]), ca.cos(q[ANGLE])), 1, STEPS)


def run(steps: Steps, base: int) -> Any:
    """Command and parameters → position at the samples."""
    u, q, known = symbols()
    after = chain(steps, 0, base)(START, u, known)[1]
    return ca.Function("run", [u, q], [ca.horzcat(START[2], after)])


def jacobian(steps: Steps, base: int) -> Any:
    """Command and parameters → slopes of the position by the free parameters, relative to their values."""
    (u, q, known), count = symbols(), len(FREE)
    begin = np.column_stack([START, START_SLOPES]).ravel()
    after = chain(steps, count, base)(begin, u, known)[1][1:, :]
    scaled = after * ca.repmat(ca.vertcat(*(q[place] for place in FREE)), 1, STEPS)
    return ca.Function("jacobian", [u, q], [ca.horzcat(ca.DM.zeros(count, 1), scaled)])


def gradient(steps: Steps, base: int) -> Any:
    """Levels of the command → gradient of the squared misfit to 20 mm, backward over the stored states."""
    z, u, q, after = sample(steps, 0)
    beside, pull = ca.SX.sym("beside", 12), ca.SX.sym("pull")
    back = ca.jtimes(after, ca.vertcat(z, u), beside, True)
    arriving = back[:12] + ca.vertcat(0, 0, pull, *[0] * 9)
    step = ca.Function("back", [beside, z, u, pull, q], [arriving, back[12]], {"cse": True})
    given, (_, parameters, known) = ca.MX.sym("levels", 1, SAMPLES // LEVEL_SAMPLES), symbols()
    command = ca.vec(ca.repmat(given, LEVEL_SAMPLES, 1)).T[:, :STEPS]
    states = ca.horzcat(START, chain(steps, 0, base)(START, command, known)[0])
    pulls, turned = 2 * (states[2, :] - 0.02), list(range(STEPS - 1, -1, -1))
    last = ca.vertcat(0, 0, pulls[-1], ca.DM.zeros(9))
    backward = step.mapaccum("backward", STEPS, {"base": base})
    slopes = backward(last, states[:, turned], command[turned], pulls[turned], known)[1]
    of_samples = ca.horzcat(slopes[turned], 0)
    found = ca.sum1(ca.reshape(of_samples, LEVEL_SAMPLES, SAMPLES // LEVEL_SAMPLES))
    return ca.Function("gradient", [given, parameters], [found])


def compiled(name: str, steps: Steps) -> Callable[[], np.ndarray]:
    """The fastest build of run, jacobian or gradient, as a call without arguments."""
    make = {"run": run, "jacobian": jacobian, "gradient": gradient}[name]
    given = (COMMAND[::LEVEL_SAMPLES], VALUES) if name == "gradient" else GIVEN
    call = quickest(lambda base: make(steps, base), given).call
    return lambda: call()[0]


def batch(steps: Steps, runs: int, cores: int) -> Callable[[], np.ndarray]:
    """Runs of different masses on all cores, largest positions.

    By CasADi's threads; by OpenMP in the C that it writes a batch took 3 to 5 % longer.
    """

    def top(base: int) -> Any:
        q = ca.MX.sym("q", len(NAMES))
        return ca.Function("top", [q], [ca.mmax(run(steps, base)(COMMAND[None, :STEPS], q))])

    of_each = np.repeat(VALUES[:, None], runs, axis=1)
    of_each[MASS] = masses(runs)
    call = caller(quickest(top, [VALUES]).function.map(runs, "thread", cores), of_each)
    return lambda: call()[0].ravel()
