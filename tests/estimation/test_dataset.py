"""Residuals that share errors: against the dense root of their covariance."""

import numpy as np
import pytest
from scipy.linalg import sqrtm

from jaxmuscle.estimation.dataset import Whitening

RNG = np.random.default_rng(5)
SIZES = ((3, 7), (3, 4))
"""Windows and residuals of each link."""


def dense(shares):
    """C^{-1/2} of all residuals, one link after the other."""
    places = np.cumsum([0, *(w * n for w, n in SIZES)])
    total, covariance = places[-1], np.eye(places[-1])
    for window in range(3):
        whole = np.zeros((total, shares[0].shape[-1]))
        for begin, (_, n), share in zip(places, SIZES, shares, strict=False):
            whole[begin + window * n : begin + (window + 1) * n] = share[window]
        covariance += whole @ whole.T
    return np.real(np.asarray(sqrtm(np.linalg.inv(covariance))))


@pytest.mark.parametrize("scale", [1e-8, 1.0, 1e3])
@pytest.mark.parametrize("errors", [1, 2])
def test_is_the_root_of_the_inverse_covariance(errors, scale):
    shares = [scale * RNG.normal(size=(*size, errors)) for size in SIZES]
    values = RNG.normal(size=(2, 5, 33))
    np.testing.assert_allclose(Whitening.of(shares)(values), values @ dense(shares), rtol=1e-6, atol=1e-6)


def test_shared_errors_become_independent():
    """Drawn with the covariance, they come out with variance one and no correlation."""
    shares = [2.0 * RNG.normal(size=(*size, 2)) for size in SIZES]
    drawn = RNG.normal(size=(40000, 3, 2))
    parts = [RNG.normal(size=(40000, *s.shape[:2])) + np.einsum("awm,wnm->awn", drawn, s) for s in shares]
    found = Whitening.of(shares)(np.concatenate([part.reshape(40000, -1) for part in parts], axis=1))
    np.testing.assert_allclose(np.cov(found.T), np.eye(33), atol=0.05)


def test_without_a_share_nothing_changes():
    values = RNG.normal(size=33)
    shares = [np.zeros((*size, 1)) for size in SIZES]
    np.testing.assert_array_equal(Whitening.of(shares)(values), values)
