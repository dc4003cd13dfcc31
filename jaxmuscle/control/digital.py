"""A controller on a clock of its own: sample time, computation delay, converters of finite resolution."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
from jaxtyping import Array, Int

from jaxmuscle.control.pid import check_signs
from jaxmuscle.control.quantisation import quantised
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter

NEAR = 1e-6
"""Share of the loop's step within which two instants are one."""


class OnClock(eqx.Module):
    """State of a digital controller.

    Attributes:
        controller: state of the controller within.
        sample: of the loop, counted from its begin; acted: the one at which it acted last.
        computed: the output of that sample; given: the one that acts now.
    """

    controller: Any
    sample: Int[Array, ""]
    acted: Int[Array, ""]
    computed: Scalar
    given: Scalar


class DigitalController(eqx.Module):
    r"""A controller of one reading as a microcontroller runs it: at instants of its own, a little late.

    At the instants :math:`t_n = n T`, T the `period`, it reads its sensor through a converter that rounds to
    `resolution`; what it computes, rounded to `output_resolution`, acts from :math:`t_n + τ` on, τ the
    `delay`, and is held until the next takes its place. The loop is read more often than that: its step is
    that of the simulation. Before the first output acts it is zero, the rest of the channel.

    Instants have to be instants of the loop: T and τ are whole multiples of its step. With `jitter` they need
    not be: as under the tick of an operating system, what is due happens at the first sample of the loop
    from then on, and the controller within is told the time that has really passed. Delays longer than a
    period, or between samples, are those of the machine: :class:`~jaxmuscle.effects.CommandDelay`.

    Derivatives pass through rounding as if there were none; by the period and the delay there are none.
    :func:`jaxmuscle.tune` moves the gains of the controller within, "controller.proportional".
    """

    controller: Any
    period: Scalar = parameter("s", "sample time T", positive=True)
    delay: Scalar = parameter("s", "time τ from a sample to its output", default=0.0, nonnegative=True)
    resolution: Scalar = parameter(
        "{output}", "step to which the reading is rounded, 0 for none", default=0.0, nonnegative=True
    )
    output_resolution: Scalar = parameter(
        "{input}", "step to which the output is rounded, 0 for none", default=0.0, nonnegative=True
    )
    jitter: bool = eqx.field(static=True, default=False)

    def __check_init__(self) -> None:
        """Raise `InputError` for numbers of the wrong sign, a delay beyond the period, no controller."""
        check_signs(self)
        if not all(callable(getattr(self.controller, method, None)) for method in ("start", "update")):
            raise InputError(
                "DigitalController: expected a controller with the methods start and update; got "
                f"{type(self.controller).__name__}"
            )
        if isinstance(self.delay, jax.core.Tracer) or isinstance(self.period, jax.core.Tracer):
            return
        if bool((jnp.asarray(self.delay) > jnp.asarray(self.period) * (1 + NEAR)).any()):
            raise InputError(
                f"DigitalController: expected a delay of one period at most, {self.period} s; got "
                f"{self.delay} s. A longer one is the machine's: "
                "actuator.with_effects(command_delay=jaxmuscle.effects.CommandDelay(…))"
            )

    @property
    def gains(self) -> tuple[str, ...]:
        """What is tuned when nothing else is asked for."""
        return tuple(f"controller.{name}" for name in getattr(self.controller, "gains", ()))

    @property
    def reads(self) -> str | None:
        """Unit of the reading, if the controller within has one."""
        return getattr(self.controller, "reads", None)

    @property
    def gives(self) -> str | None:
        """Unit of the output, if the controller within has one."""
        return getattr(self.controller, "gives", None)

    @property
    def of_one_number(self) -> bool:
        """Whether the controller within follows a value alone."""
        return getattr(self.controller, "of_one_number", False)

    def start(self, *at: Any) -> OnClock:
        """The state at the first sample; `at` is what the `start` of the controller within takes."""
        none, zero = jnp.asarray(0), jnp.zeros(())
        return OnClock(self.controller.start(*at), none, none, zero, zero)

    def update(
        self, state: OnClock, wanted: Any, measured: Scalar, step: float | Scalar
    ) -> tuple[OnClock, Scalar]:
        """The state after a sample of the loop, `step` seconds long, and the output u until the next."""
        since = (state.sample - state.acted) * step
        first = state.sample == 0
        acts = first | (self._periods(state.sample, step) > self._periods(state.sample - 1, step))
        passed = jnp.where(first, self.period, since)
        seen = quantised(measured, self.resolution)
        inner, output = self.controller.update(state.controller, wanted, seen, passed)
        output = quantised(output, self.output_resolution)
        given = jnp.where(since >= self.delay - NEAR * step, state.computed, state.given)
        at_once = acts & (self.delay <= NEAR * step)
        after = OnClock(
            jax.tree.map(lambda new, old: jnp.where(acts, new, old), inner, state.controller),
            state.sample + 1,
            jnp.where(acts, state.sample, state.acted),
            jnp.where(acts, output, state.computed),
            jnp.where(at_once, output, given),
        )
        return after, after.given

    def without_windup(
        self, before: OnClock, after: OnClock, output: Scalar, lowest: Scalar, highest: Scalar
    ) -> OnClock:
        """The state after a sample of the loop: where it acted, the controller within is told the limits."""
        if not hasattr(self.controller, "without_windup"):
            return after
        held = self.controller.without_windup(
            before.controller, after.controller, after.computed, lowest, highest
        )
        acted = after.acted == before.sample
        kept = jax.tree.map(lambda new, old: jnp.where(acted, new, old), held, after.controller)
        return eqx.tree_at(lambda state: state.controller, after, kept)

    def _periods(self, sample: Array, step: float | Scalar) -> Array:
        """Whole periods that have begun at a sample of the loop."""
        return jnp.floor((sample + NEAR) * step / self.period)

    def check_clock(self, step: float) -> None:
        """Raise `InputError` where its instants are none of a loop of a step [s]."""
        period, delay = float(self.period), float(self.delay)
        if period < step * (1 - NEAR):
            raise InputError(
                f"DigitalController: expected a period of at least the loop's step, {step:g} s; got "
                f"{period:g} s. Give the loop a clock with a smaller step"
            )
        uneven = [(n, t) for n, t in (("period", period), ("delay", delay)) if not _is_whole(t / step)]
        if uneven and not self.jitter:
            name, time = uneven[0]
            raise InputError(
                f"DigitalController: expected a {name} that is a whole multiple of the loop's step, "
                f"{step:g} s; got {time:g} s. Give the loop a step that divides it, or jitter=True: what is "
                "due then happens at the first sample of the loop from then on"
            )
        if not _is_whole(period / step) and delay > period - step * (1 - NEAR):
            raise InputError(
                f"DigitalController: with jitter, expected a delay of at most the period less the loop's "
                f"step, {period - step:g} s; got {delay:g} s"
            )


def _is_whole(number: float) -> bool:
    return abs(number - round(number)) <= NEAR * max(1.0, abs(number))


def digital_controllers(controller: Any) -> list[DigitalController]:
    """All digital controllers within a controller, itself included."""
    leaves = jax.tree.leaves(controller, is_leaf=lambda part: isinstance(part, DigitalController))
    found = [leaf for leaf in leaves if isinstance(leaf, DigitalController)]
    return [*found, *(inner for each in found for inner in digital_controllers(each.controller))]


def check_clocks(controller: Any, step: float) -> None:
    """Raise `InputError` where a digital controller within one cannot run in a loop of a step [s]."""
    for each in digital_controllers(controller):
        if not isinstance(each.period, jax.core.Tracer) and not isinstance(each.delay, jax.core.Tracer):
            each.check_clock(step)
