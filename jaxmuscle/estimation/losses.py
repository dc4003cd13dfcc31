"""Loss functions of residuals: squares, Huber, Student."""

from __future__ import annotations

import abc
import dataclasses

import numpy as np
from numpy.typing import NDArray

from jaxmuscle.errors import InputError, nearest

Array = NDArray[np.float64]

NORMAL = np.linspace(-9.0, 9.0, 3601)
"""Where the normal distribution is summed up: beyond, it has nothing; between, its sum is its integral."""
LIMIT = 1.345
"""Residual, in units of the noise, from which it is an outlier: squares lose 5 % on normal noise by that."""
DIVISIONS, SETTLED, SMALLEST = 50, 1e-4, 1e-9
"""Times that a size is found anew at most; the relative change at which it has settled; what counts as 0."""


class Loss(abc.ABC):
    """A loss ρ(r) of residuals in units of the noise; ψ = ρ'."""

    @abc.abstractmethod
    def cost(self, r: Array) -> Array:
        """ρ(r), one half r² near zero."""

    @abc.abstractmethod
    def weight(self, r: Array) -> Array:
        """ψ(r)/r, the weight of a residual in the Gauss-Newton matrix; 1 at zero."""

    @abc.abstractmethod
    def slope(self, r: Array) -> Array:
        """ψ'(r)."""

    def weighted(self, slopes: Array, r: Array) -> Array:
        """Slopes (…, k, n) of residuals (…, n) by k unknowns, times the weights of the residuals."""
        return slopes * self.weight(r)[..., None, :]

    def rooted(self, r: Array) -> Array:
        r"""Residuals of which the squares are twice the losses: :math:`\operatorname{sign}(r) \sqrt{2 ρ(r)}`.

        Methods of least squares minimise any loss by these (Triggs, McLauchlan, Hartley and Fitzgibbon,
        "Bundle adjustment: a modern synthesis", 2000, section 4.3). NaN stays NaN.
        """
        return np.sign(r) * np.sqrt(2 * self.cost(r))

    def rooted_slopes(self, slopes: Array, r: Array) -> Array:
        r"""Slopes of :meth:`rooted`, from those (k, n) of residuals (n) by k unknowns.

        Their factor is :math:`ψ(r) / \sqrt{2 ρ(r)}`, 1 at zero; slopes at NaN stay as they are.
        """
        root = np.abs(self.rooted(r))
        there = root > 0
        return slopes * np.where(there, self.weight(r) * np.abs(r) / np.where(there, root, 1.0), 1.0)

    def cost_of_noise(self, size: Array) -> Array:
        """Mean of ρ over normal residuals of these sizes."""
        density = np.exp(-0.5 * NORMAL**2)
        return self.cost(np.multiply.outer(size, NORMAL)) @ density / density.sum()

    def scatter(self, r: Array) -> Array:
        """What a residual adds to the size of all: its square, of an outlier no more than :data:`LIMIT`²."""
        return np.minimum(np.abs(r), LIMIT) ** 2

    def mean_square(self, r: Array, axis: int | tuple[int, ...] | None = None) -> Array:
        r"""Mean of :meth:`scatter`, 1 for normal residuals of the size of the noise; NaN where there is none.

        Divided by what it is of the normal distribution (Huber 1964, Proposal 2; Maronna, Martin, Yohai and
        Salibián-Barrera 2019, "Robust Statistics", section 2.5).

        Args:
            r: residuals in units of the noise; NaN for those that do not count.
            axis: along which the mean is taken; all by default.
        """
        counts = ~np.isnan(r)
        total, many = np.where(counts, self.scatter(np.where(counts, r, 0.0)), 0.0), counts.sum(axis=axis)
        mean = np.where(many > 0, total.sum(axis=axis) / np.maximum(many, 1), np.nan)
        return mean / self._of_normal

    def size(self, r: Array, axis: int | tuple[int, ...] | None = None) -> Array:
        """The size of residuals: divided by it their :meth:`mean_square` is 1.

        By repeated division; outliers, which weigh more or less by the size, take about ten. Arguments as
        there.
        """
        found = np.ones(np.sum(r, axis=axis, keepdims=True).shape)
        for _ in range(DIVISIONS):
            change = np.sqrt(np.asarray(self.mean_square(r / found, axis))).reshape(found.shape)
            found = np.maximum(found * np.nan_to_num(change, nan=1.0), SMALLEST)
            if not np.any(np.abs(change - 1) > SETTLED):
                break
        none = np.isnan(r).all(axis=axis, keepdims=True)
        return np.where(none, np.nan, found).reshape(none.sum(axis=axis).shape)

    @property
    def _of_normal(self) -> float:
        """Mean scatter of the standard normal distribution; the sum bears kinks."""
        density = np.exp(-0.5 * NORMAL**2)
        return float((density * self.scatter(NORMAL)).sum() / density.sum())


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

    def rooted(self, r: Array) -> Array:
        """The residuals themselves."""
        return r

    def rooted_slopes(self, slopes: Array, r: Array) -> Array:
        """The slopes themselves."""
        del r
        return slopes

    def cost_of_noise(self, size: Array) -> Array:
        """Half the squares of the sizes."""
        return 0.5 * np.square(size)

    def scatter(self, r: Array) -> Array:
        """r²."""
        return r**2

    def size(self, r: Array, axis: int | tuple[int, ...] | None = None) -> Array:
        """The root mean square, without division by turns."""
        return np.sqrt(np.asarray(self.mean_square(r, axis)))

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


SQUARES = Squares()
LOSSES: dict[str, Loss] = {"squares": SQUARES, "huber": Huber(), "student": Student()}


def loss_named(loss: str | Loss) -> Loss:
    """The loss of that name, or the one that is given.

    Raises:
        InputError: there is no such loss.
    """
    if isinstance(loss, Loss):
        return loss
    if not isinstance(loss, str) or loss not in LOSSES:
        raise InputError(f"loss: unknown {loss!r}{nearest(str(loss), LOSSES)}")
    return LOSSES[loss]
