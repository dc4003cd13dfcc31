"""Effects of the command on its way to the opening of a valve or the set-point of a regulator: delay,
offset, limited rate, hysteresis, dead band. They act in this order, delay and offset side by side.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array

from jaxmuscle.effects.base import COMMANDED, LOOP, AbstractMemoryEffect, AbstractStaticEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import COMMAND, Signals

SMALL_COMMAND = {"V": 0.1, "Pa": 2e3}
"""Natural size of an error of a command, by its unit."""


class CommandDelay(AbstractStaticEffect):
    """The command acts `delay` seconds late: u(t - delay) - u(t), zero-order hold, exact between samples."""

    name: ClassVar = "command_delay"
    slot: ClassVar = COMMAND
    reads: ClassVar = frozenset({"command", "past"})
    strength: ClassVar = "delay"
    largest: ClassVar = 1.0
    starts: ClassVar = tuple({"delay": delay} for delay in (0.003, 0.006, 0.012, 0.025, 0.05, 0.1))
    source: ClassVar = "dead time"

    delay: Scalar = parameter("s", "dead time of the command", default=0.0, nonnegative=True)

    def value(self, signals: Signals) -> Array:
        assert signals.past is not None
        return signals.past.late(self.delay) - signals.past(0.0 * self.delay)


class ValveOffset(AbstractStaticEffect):
    r"""A constant is added to the command: :math:`Δu = u_0`.

    The spool of a flow valve is not centred, so that it is shut at the command -u0; a regulator holds a
    pressure that is u0 too high. Two or more regulators of one machine have the same offset.
    """

    name: ClassVar = "valve_offset"
    slot: ClassVar = COMMAND
    reads: ClassVar = frozenset({"command", "spool"})
    strength: ClassVar = "offset"
    starts: ClassVar = ({},)
    source: ClassVar = "null shift of a valve, Merritt, Hydraulic Control Systems (1967)"
    view: ClassVar = COMMANDED

    offset: Scalar = parameter(
        "{command}", "what the valve adds to its command", default=0.0, typical=SMALL_COMMAND
    )

    def value(self, signals: Signals) -> Array:
        return self.offset + jnp.zeros_like(signals.command)


class SpoolHysteresis(AbstractMemoryEffect):
    r"""The spool of a flow valve, or the pressure of a regulator, follows its command behind a play.

    .. math:: Δu = F_r[u] - u,\quad F_r[u] = \max(u - r, \min(u + r, F_r^-))

    On the way up it is the half-width r too low, on the way down too high. Exact for a command that is held
    from sample to sample. At first the play stands in its middle. `valve_hysteresis` on rigs that have a
    spool; that of a jet pipe is :class:`ValveHysteresis`.
    """

    name: ClassVar = "valve_hysteresis"
    slot: ClassVar = COMMAND
    reads: ClassVar = frozenset({"command", "spool"})
    strength: ClassVar = "half_width"
    starts: ClassVar = ({},)
    source: ClassVar = "play operator, [W] equation 1"
    stage: ClassVar = 2
    view: ClassVar = LOOP

    half_width: Scalar = parameter(
        "{command}",
        "half-width of the play between command and valve",
        default=0.0,
        nonnegative=True,
        typical=SMALL_COMMAND,
    )

    def initial(self, signals: Signals) -> tuple[Array, Array]:
        return jnp.asarray(signals.command), jnp.zeros_like(signals.command)

    def update(self, memory: tuple[Array, Array], signals: Signals, step: Array) -> tuple[Array, Array]:
        return jnp.asarray(signals.command), self._place(memory, signals)

    def value(self, memory: tuple[Array, Array], signals: Signals) -> Array:
        return self.half_width * self._place(memory, signals)

    def _place(self, memory: tuple[Array, Array], signals: Signals) -> Array:
        """Where in its play the valve is, from -1 (behind a rise) to 1.

        It is kept rather than the valve's position: of no play, too, it tells which side is touched, and
        so what a little play would add.
        """
        before, place = memory
        move = signals.command - before
        some = self.half_width > 0
        moved = place - move / jnp.where(some, self.half_width, 1.0)
        inside = jnp.where(jnp.abs(moved) < 1, moved, jnp.sign(moved))
        touched = jnp.where(move == 0, place, -jnp.sign(move))
        return jnp.where(some, inside, touched)


class DeadBand(AbstractStaticEffect):
    r"""The valve does not react to small commands: :math:`Δu = -\mathrm{clip}(u - u_n, -w, w)`.

    .. math:: u - u_n \;\to\; \mathrm{sgn}(u - u_n)\,\max(|u - u_n| - w, 0)

    u_n is the command under which the valve is shut: 0 for a flow valve, whose spool overlaps its ports; for
    a regulator the pressure that it has reached, so that it leaves differences below w alone.
    """

    name: ClassVar = "dead_band"
    slot: ClassVar = COMMAND
    reads: ClassVar = frozenset({"command", "neutral"})
    strength: ClassVar = "width"
    starts: ClassVar = ({},)
    source: ClassVar = "overlapped spool, Merritt, Hydraulic Control Systems (1967)"
    stage: ClassVar = 3
    view: ClassVar = COMMANDED

    width: Scalar = parameter(
        "{command}",
        "command up to which the valve stays shut, to either side",
        default=0.0,
        nonnegative=True,
        typical=SMALL_COMMAND,
    )

    def value(self, signals: Signals) -> Array:
        away = signals.command - signals.neutral
        # At no width and no difference the slopes are those without the effect.
        lost = jnp.where(jnp.abs(away) >= self.width, self.width * jnp.sign(away), away)
        return -lost * signals.moves_valve


class RateLimit(AbstractMemoryEffect):
    r"""The command passes a limiter of its rate: y follows u by at most r per second.

    .. math:: \dot y = \mathrm{clip}\!\left(\frac{u - y}{0^+}, -r, r\right),\qquad
        Δu = \frac1h \int_0^h (y - u)\,dt = -(u - y)\,g\!\left(\frac{|u - y|}{r h}\right),\quad
        g(f) = \begin{cases} f/2 & f ≤ 1 \\ 1 - 1/(2f) & f > 1 \end{cases}

    y in the last expression is where a step of the simulation, h long, begins; the mean over the step acts in
    all of it, as of a command that is held. The lag of the spool, or of the regulator, comes after it. The
    strength is 1/r, zero without a limit; a small one changes next to nothing.
    """

    name: ClassVar = "rate_limit"
    slot: ClassVar = COMMAND
    reads: ClassVar = frozenset({"command", "spool"})
    strength: ClassVar = "inverse_rate"
    starts: ClassVar = tuple(
        {"inverse_rate": 1 / rate} for rate in (200.0, 80.0, 30.0, 12.0, 5.0, 2e7, 8e6, 3e6, 1.2e6, 5e5)
    )
    """The first five for commands in volts, the others for pressures."""
    source: ClassVar = "slew rate, velocity saturation of a valve, Merritt, Hydraulic Control Systems (1967)"
    stage: ClassVar = 1

    inverse_rate: Scalar = parameter(
        "s/({command})",
        "one over the largest rate at which the valve follows",
        default=0.0,
        nonnegative=True,
        typical={"s/(V)": 0.02, "s/(Pa)": 5e-7},
    )

    def initial(self, signals: Signals) -> tuple[Array, Array]:
        # No step was made yet, whose length the next one has: it may be all of a sample.
        step = jnp.zeros(()) if signals.past is None else signals.past.step
        return jnp.asarray(signals.command), jnp.asarray(step)

    def update(self, memory: tuple[Array, Array], signals: Signals, step: Array) -> tuple[Array, Array]:
        before, _ = memory
        ahead = signals.command - before
        return before + ahead / jnp.maximum(self._steps(ahead, step), 1.0), jnp.asarray(step)

    def value(self, memory: tuple[Array, Array], signals: Signals) -> Array:
        before, step = memory
        ahead = signals.command - before
        steps = self._steps(ahead, step)
        return -ahead * jnp.where(steps > 1, 1 - 0.5 / jnp.maximum(steps, 1.0), 0.5 * steps)

    def _steps(self, ahead: Array, step: Array) -> Array:
        """Steps that it takes to catch up; none in a step of no length."""
        return jnp.abs(ahead) * self.inverse_rate / jnp.where(step > 0, step, jnp.inf)
