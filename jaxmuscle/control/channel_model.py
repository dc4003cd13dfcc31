"""A machine as its control channel sees it: linearised about a point of rest and sampled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import ArrayLike
from numpy.typing import NDArray
from scipy.linalg import expm

from jaxmuscle.actuators import Actuation
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.analysis import OperatingPoint, equilibrium, linearise
from jaxmuscle.effects import CommandDelay
from jaxmuscle.effects.base import AbstractFrictionEffect, AbstractSlipEffect
from jaxmuscle.errors import InputError

Matrix = NDArray[np.float64]


class ChannelModel(NamedTuple):
    r"""From an output u of a controller to the reading, sample by sample, about a point of rest.

    .. math:: x_{k+1} = A x_k + B u_k, \quad y_k = y_0 + C x_k

    Attributes:
        a, b, c: of the states in the order `states`.
        rest: y0, reading at the point (SI).
        states: their names.
    """

    a: Matrix
    b: Matrix
    c: Matrix
    rest: float
    states: tuple[str, ...]

    @property
    def gain(self) -> float:
        """Reading per output at rest; infinite or no number of a machine that integrates."""
        with np.errstate(all="ignore"):
            try:
                return float(self.c @ np.linalg.solve(np.eye(len(self.a)) - self.a, self.b))
            except np.linalg.LinAlgError:
                return float("inf")

    def impulse(self, samples: int) -> Matrix:
        """Readings at the samples after the one at which an output of one was held for a step."""
        found, state = np.empty(samples), self.b
        for k in range(samples):
            found[k] = self.c @ state
            state = self.a @ state
        return found


def channel_model(
    actuator: AbstractActuator,
    step: float,
    point: OperatingPoint | None = None,
    *,
    delayed: bool = True,
    **settings: ArrayLike,
) -> ChannelModel:
    """The channel of a rig, linearised and sampled; dry friction, effects and all as the machine has them.

    A delay of the command is one of whole samples and of a part of one, in which the output of the sample
    before still acts: earlier outputs are states (Åström and Wittenmark, Computer-Controlled Systems, 3rd ed.
    1997, section 2.6).

    Args:
        step: sampling step of the loop, over which the command is held [s].
        point: at rest under an output of zero when `None`.
        delayed: whether a delay of the command counts.
        settings: of the rig's `actuation`, as for :func:`feedback_on`.

    Raises:
        InputError: a rig without a channel, a step that is not above zero, no point of rest, a reading that
            jumps with the command.
    """
    channel, acts = actuator.declared_channel(), actuator.actuation(**settings)
    return sampled_model(actuator, step, channel.reading, acts, point, delayed=delayed)


def sampled_model(
    actuator: AbstractActuator,
    step: float,
    reading: str,
    acts: Actuation,
    point: OperatingPoint | None,
    *,
    delayed: bool = True,
) -> ChannelModel:
    """The model of :func:`channel_model` of any reading, with outputs that act on the commands by `acts`."""
    if not 0 < step < np.inf:
        raise InputError(f"step: expected a time above zero [s]; got {step!r}")
    point = equilibrium(actuator, acts.rest) if point is None else point
    linear = linearise(actuator, point)
    direction = np.atleast_1d(np.asarray(acts.direction, dtype=float))
    row = linear.outputs.index(actuator.outputs[reading][0])
    if np.any(np.asarray(linear.d)[row] != 0):
        raise InputError(
            f"expected a reading that moves with the states; the {reading} jumps with the command"
        )
    late = _delay(actuator) if delayed else 0.0
    a, b = _held_late(np.asarray(linear.a), np.asarray(linear.b) @ direction, step, late)
    earlier = tuple(f"output {n} samples before" for n in range(len(a) - len(linear.states), 0, -1))
    c = np.append(np.asarray(linear.c, dtype=float)[row], np.zeros(len(earlier)))
    return ChannelModel(a, b, c, float(point.readings[row]), (*linear.states, *earlier))


def without_dry_friction(actuator: AbstractActuator) -> AbstractActuator:
    """A copy without dry friction, which holds a machine at rest wherever it is."""
    dry = AbstractFrictionEffect | AbstractSlipEffect
    return actuator.without_effects(*(name for name, e in actuator.effects.items() if isinstance(e, dry)))


def _delay(actuator: AbstractActuator) -> float:
    """Delay of the command [s]."""
    return sum(float(e.delay) for e in actuator.effects.values() if isinstance(e, CommandDelay))


def _held_late(a: Matrix, b: Matrix, step: float, late: float) -> tuple[Matrix, Matrix]:
    """A and B of a model whose input is held for a step and acts late [s]; earlier inputs are states."""
    whole, part = divmod(late / step, 1.0)
    samples = int(whole) + round(part) if min(part, 1 - part) < 1e-9 else int(whole) + 1
    begin = 0.0 if min(part, 1 - part) < 1e-9 else part * step
    own, (onward, newer) = len(a), _held(a, b, step - begin)
    if not samples:
        return onward, newer
    after, older = _held(a, b, begin)
    found, entering = np.zeros((own + samples, own + samples)), np.zeros(own + samples)
    found[:own, :own] = onward @ after
    # The oldest input comes first: it acts until `begin`, the one after it from then on.
    found[:own, own] = onward @ older if begin else newer
    if begin and samples > 1:
        found[:own, own + 1] = newer
    found[own:-1, own + 1 :] = np.eye(samples - 1)
    entering[-1] = 1.0
    if begin and samples == 1:
        entering[:own] = newer
    return found, entering


def _held(a: Matrix, b: Matrix, step: float) -> tuple[Matrix, Matrix]:
    """A and B of a model whose input is held for a step."""
    size = len(a)
    both = np.zeros((size + 1, size + 1))
    both[:size, :size], both[:size, size] = a, b
    whole = np.asarray(expm(step * both), dtype=float)
    return whole[:size, :size], whole[:size, size]
