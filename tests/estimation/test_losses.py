"""Losses of residuals: derivatives, what outliers pull, the size of residuals."""

import numpy as np
import pytest

from jaxmuscle.estimation.losses import LOSSES, Huber, Loss, Squares, Student, loss_named


@pytest.mark.parametrize("name", ["squares", "huber", "student"])
def test_losses_and_their_derivatives(name):
    loss, r, h = loss_named(name), np.array([-7.0, -1.2, 0.3, 1.1, 4.0]), 1e-6
    psi = (loss.cost(r + h) - loss.cost(r - h)) / (2 * h)
    np.testing.assert_allclose(loss.weight(r) * r, psi, rtol=1e-6)
    curving = ((loss.weight(r + h) * (r + h)) - (loss.weight(r - h) * (r - h))) / (2 * h)
    np.testing.assert_allclose(loss.slope(r), curving, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(loss.cost(np.array([1e-4])), 0.5e-8, rtol=1e-6)


def test_robust_losses_bound_the_pull():
    far = np.array([1e3, 1e6])
    assert np.ptp(Huber().weight(far) * far) == 0
    pull = Student().weight(far) * far
    assert pull[1] < pull[0] < 0.01
    assert set(LOSSES) == {"squares", "huber", "student"}


class Biweight(Loss):
    """A loss of one's own, which lets go of what is far off."""

    def cost(self, r):
        return np.where(np.abs(r) < 3, 1.5 * (1 - (1 - r**2 / 9) ** 3), 1.5)

    def weight(self, r):
        return np.where(np.abs(r) < 3, (1 - r**2 / 9) ** 2, 0.0)

    def slope(self, r):
        return np.where(np.abs(r) < 3, (1 - r**2 / 9) * (1 - 5 * r**2 / 9), 0.0)


@pytest.mark.parametrize("loss", [*LOSSES.values(), Biweight()])
def test_the_mean_square_of_normal_residuals_is_one(loss):
    r = np.random.default_rng(0).normal(size=(200_000, 2)) * [1.0, 1.0]
    np.testing.assert_allclose(loss.mean_square(r, 0), 1.0, atol=0.02)
    assert loss.mean_square(r) == pytest.approx(1.0, abs=0.015)
    missing = np.where(np.arange(len(r)) % 2 == 0, np.nan, r[:, 0])
    assert loss.mean_square(missing) == pytest.approx(loss.mean_square(r[1::2, 0]), rel=1e-12)
    assert np.isnan(loss.mean_square(np.array([np.nan]))) and np.isnan(loss.mean_square(np.zeros(0)))


@pytest.mark.parametrize("loss", [*LOSSES.values(), Biweight()])
def test_squares_of_rooted_residuals_are_twice_the_losses(loss):
    """With their slopes, at zero and where nothing is a number, too."""
    r, h = np.array([-7.0, -1.2, -1e-2, 0.0, 0.3, 1.1, 2.5, np.nan]), 1e-4
    root = loss.rooted(r)
    np.testing.assert_allclose(0.5 * root[:-1] ** 2, loss.cost(r[:-1]), rtol=1e-12)
    np.testing.assert_array_equal(np.sign(root), np.sign(r))
    assert np.isnan(root[-1])
    slopes = np.stack([np.ones(8), np.arange(8.0)])
    slopes[:, -1] = 0.0
    along = (loss.rooted(r[:-1] + h) - loss.rooted(r[:-1] - h)) / (2 * h)
    found = loss.rooted_slopes(slopes, r)
    np.testing.assert_allclose(found[:, :-1], slopes[:, :-1] * along, rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(found[:, -1], 0.0)


@pytest.mark.parametrize("loss", [*LOSSES.values(), Biweight()])
def test_the_cost_of_noise_is_the_mean_over_noise(loss):
    r = np.random.default_rng(0).normal(size=400_000)
    sizes = np.array([0.01, 0.5, 1.0, 3.0])
    found = loss.cost_of_noise(sizes)
    np.testing.assert_allclose(found, [loss.cost(size * r).mean() for size in sizes], rtol=0.01)
    assert found[0] == pytest.approx(0.5e-4, rel=1e-3)


@pytest.mark.parametrize("loss", [*LOSSES.values(), Biweight()])
def test_the_size_of_residuals(loss):
    """However large they seemed; beside outliers, where what weighs how much hangs on it, too."""
    rng = np.random.default_rng(0)
    normal = rng.normal(size=(40_000, 1)) * [0.3, 1.0, 4.0]
    np.testing.assert_allclose(loss.size(normal, 0), [0.3, 1.0, 4.0], rtol=0.03)
    wild = np.where(rng.random(20_000) < 0.1, 15.0, 1.0) * rng.normal(size=20_000)
    size = loss.size(wild)
    assert isinstance(loss, Squares) or 1.0 < size < 1.25
    assert loss.mean_square(wild / size) == pytest.approx(1.0, rel=1e-3)
    assert loss.size(3 * wild) == pytest.approx(3 * size, rel=2e-3)
    some = np.where(np.arange(20_000) < 10_000, wild, np.nan)
    assert loss.size(some) == pytest.approx(loss.size(wild[:10_000]), rel=1e-9)
    assert np.isnan(loss.size(np.array([np.nan]))) and loss.size(np.zeros(5)) < 1e-6


def test_the_mean_square_of_squares_is_the_mean_square():
    r = np.random.default_rng(0).normal(size=30)
    assert LOSSES["squares"].mean_square(r) == pytest.approx(np.mean(r**2), rel=1e-12)


@pytest.mark.parametrize("loss", [*LOSSES.values(), Biweight()])
def test_weighted_slopes(loss):
    rng = np.random.default_rng(0)
    slopes, r = rng.normal(size=(2, 3, 40)), 2 * rng.normal(size=(2, 40))
    expected = np.einsum("akn,an->akn", slopes, loss.weight(r))
    np.testing.assert_array_equal(loss.weighted(slopes, r), expected)
    np.testing.assert_array_equal(loss.weighted(slopes[0], r[0]), expected[0])
