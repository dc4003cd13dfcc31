"""Feed-forward: what a model says of the command, added to any feedback controller of one reading."""

from __future__ import annotations

from typing import Any, Protocol

import equinox as eqx
import jax.numpy as jnp

from jaxmuscle.control.pid import check_signs
from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.errors import InputError
from jaxmuscle.parameters import Scalar, parameter


class Inverse(Protocol):
    """What :class:`FeedForward` asks of an inverse: an `eqx.Module` or other pytree with these methods.

    One whose input is integrated may have ``limited(before, after, lowest, highest)`` → state, which is told
    within which limits its input was given.
    """

    def start(self) -> Any:
        """The state at the first sample."""
        ...

    def update(self, state: Any, target: Any, step: Any) -> tuple[Any, Any]:
        """The state after a sample of `step` seconds, and the output u that leads to the target."""
        ...


class Added(eqx.Module):
    """State of a feed-forward: those of inverse and feedback, and what the inverse gave [output]."""

    inverse: Any
    feedback: Any
    ahead: Scalar


class FeedForward(eqx.Module):
    r"""Inverse of a model and feedback: :math:`u = s\,u_1(r) + u_{fb}(r, y)`.

    u_1 is what leads the model to the reference, and the feedback, any controller of one reading, has left
    what the model does not know. An inverse of a rig is made by
    :func:`~jaxmuscle.control.model_inverse` or :func:`~jaxmuscle.control.simulated_inverse`; one of
    hysteresis is an :class:`~jaxmuscle.hysteresis.IntegralInverse` or
    :class:`~jaxmuscle.hysteresis.AnalyticInverse`; any object with the methods of :class:`Inverse` will do.
    Without a feedback the loop is open. What the feedback integrates waits while the sum is beyond the limits
    of the command.

    :func:`jaxmuscle.tune` moves the share s and the gains of the feedback, "feedback.proportional".
    """

    inverse: Any
    feedback: Any = None
    share: Scalar = parameter("", "share s of the inverse's output", default=1.0, nonnegative=True)

    def __check_init__(self) -> None:
        """Raise `InputError` for a negative share, or parts without the methods that they need."""
        check_signs(self)
        for name, part in (("inverse", self.inverse), ("feedback", self.feedback)):
            known = all(callable(getattr(part, method, None)) for method in ("start", "update"))
            if not known and (name == "inverse" or part is not None):
                raise InputError(
                    f"FeedForward: expected {name} to have the methods start and update; got "
                    f"{type(part).__name__}"
                )

    @property
    def gains(self) -> tuple[str, ...]:
        """What is tuned when nothing else is asked for."""
        parts = {"inverse": self.inverse, "feedback": self.feedback}
        inner = (f"{part}.{name}" for part, own in parts.items() for name in getattr(own, "gains", ()))
        return "share", *inner

    @property
    def reads(self) -> str | None:
        """Unit of the reading, if the feedback has one."""
        return getattr(self.feedback, "reads", None)

    @property
    def gives(self) -> str | None:
        """Unit of the output, if the feedback has one."""
        return getattr(self.feedback, "gives", None)

    @property
    def of_one_number(self) -> bool:
        """Whether the feedback follows a value alone."""
        return self.feedback is not None and getattr(self.feedback, "of_one_number", False)

    def start(self, *at: Any) -> Added:
        """The state at the first sample; `at` is what the feedback's own `start` takes."""
        own = None if self.feedback is None else self.feedback.start(*at)
        return Added(self.inverse.start(), own, jnp.zeros(()))

    def update(
        self, state: Added, wanted: Any, measured: Scalar, step: float | Scalar
    ) -> tuple[Added, Scalar]:
        """The state after a sample of `step` seconds, and the output u until the next."""
        inverse, ahead = self.inverse.update(state.inverse, target_of(wanted), step)
        ahead = self.share * ahead
        if self.feedback is None:
            return Added(inverse, None, ahead), ahead
        own, output = self.feedback.update(state.feedback, wanted, measured, step)
        return Added(inverse, own, ahead), ahead + output

    def without_windup(
        self, before: Added, after: Added, output: Scalar, lowest: Scalar, highest: Scalar
    ) -> Added:
        """The state after a sample whose output is limited: both parts are told of what is left to them."""
        own, inverse = after.feedback, after.inverse
        if hasattr(self.feedback, "without_windup"):
            rest = (limit - after.ahead for limit in (lowest, highest))
            own = self.feedback.without_windup(before.feedback, own, output - after.ahead, *rest)
        if hasattr(self.inverse, "limited"):
            inverse = self.inverse.limited(before.inverse, inverse, lowest, highest)
        return Added(inverse, own, after.ahead)
