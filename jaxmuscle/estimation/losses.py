"""What a residual costs: its square, or less when it is large."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.errors import InputError, nearest
from jaxmuscle.estimation.loss import Loss

Array = NDArray[np.float64]


@dataclasses.dataclass(frozen=True)
class Squares(Loss):
    """ρ = r²/2."""

    def cost(self, r: Array) -> Array:
        """ρ(r)."""
        return 0.5 * r**2

    def weighted(self, slopes: Array, r: Array) -> Array:
        """The slopes themselves: all weights are 1."""
        del r
        return slopes

    def scatter(self, r: Array) -> Array:
        """r²."""
        return r**2

    def weight(self, r: Array) -> Array:
        """ψ(r)/r."""
        return np.ones_like(r)

    def slope(self, r: Array) -> Array:
        """ψ'(r)."""
        return np.ones_like(r)


@dataclasses.dataclass(frozen=True)
class Huber(Loss):
    """Huber (1964): r²/2 up to `limit`, linear beyond; 1.345 loses 5 % on normal noise."""

    limit: float = 1.345

    def cost(self, r: Array) -> Array:
        """ρ(r)."""
        size = np.abs(r)
        return np.where(size <= self.limit, 0.5 * r**2, self.limit * (size - 0.5 * self.limit))

    def weight(self, r: Array) -> Array:
        """ψ(r)/r."""
        return self.limit / np.maximum(np.abs(r), self.limit)

    def slope(self, r: Array) -> Array:
        """ψ'(r)."""
        return (np.abs(r) <= self.limit).astype(float)


@dataclasses.dataclass(frozen=True)
class Student(Loss):
    """Student's t with ν `freedom` (Lange et al. 1989): ρ = ν/2 ln(1 + r²/ν), which has weight 1 at zero."""

    freedom: float = 4.0

    def cost(self, r: Array) -> Array:
        """ρ(r)."""
        return 0.5 * self.freedom * np.log1p(r**2 / self.freedom)

    def weight(self, r: Array) -> Array:
        """ψ(r)/r."""
        return self.freedom / (self.freedom + r**2)

    def slope(self, r: Array) -> Array:
        """ψ'(r)."""
        return self.freedom * (self.freedom - r**2) / (self.freedom + r**2) ** 2


LOSSES: dict[str, Loss] = {"squares": Squares(), "huber": Huber(), "student": Student()}


def loss_named(loss: str | Loss) -> Loss:
    """The loss of that name, or the one that is given.

    Raises:
        InputError: there is no such loss.
    """
    if isinstance(loss, Loss):
        return loss
    if loss not in LOSSES:
        raise InputError(f"loss: unknown {loss!r}{nearest(str(loss), LOSSES)}")
    return LOSSES[loss]
