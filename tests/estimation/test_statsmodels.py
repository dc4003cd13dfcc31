"""What a fit says of its uncertainty beside statsmodels, on linear models; where a rule differs, by how much.

`jaxmuscle` divides by the number of residuals where statsmodels divides by it less the number of parameters,
takes another small-sample factor of clusters, and knows the size of the noise where `RLM` estimates it.
"""

import numpy as np
import pytest
import statsmodels.api as sm
from scipy.signal import lfilter
from statsmodels.regression.linear_model import burg as theirs_burg
from statsmodels.robust.norms import HuberT, StudentT
from statsmodels.robust.scale import Huber as ProposalTwo
from statsmodels.stats.sandwich_covariance import cov_cluster
from statsmodels.tsa.arima_process import ArmaProcess
from statsmodels.tsa.stattools import acovf

from jaxmuscle.estimation.coloured_noise import Autoregression, autocovariance, burg, coloured_meat
from jaxmuscle.estimation.covariance import PARTS, covariance
from jaxmuscle.estimation.free_parameters import Unknown, Unknowns
from jaxmuscle.estimation.losses import LIMIT, Huber, Squares, Student
from jaxmuscle.estimation.residual_analysis import Series
from jaxmuscle.optimization.descents import Limits, Local, Tolerances
from jaxmuscle.optimization.levenberg_marquardt import descend
from jaxmuscle.parameters import Parameter

ROWS, WINDOWS, COUNT = 600, 24, 3
TIME = np.arange(ROWS) / ROWS
SLOPES = np.stack([np.ones(ROWS), np.sin(12 * TIME), TIME])
WINDOW = np.arange(ROWS) // (ROWS // WINDOWS)
FREE = np.zeros(COUNT, dtype=bool)
SQUARES = Squares()


def unknowns():
    """Three without priors or bounds, in units of themselves."""
    places = [Parameter(path=f"p{i}", value=0.0) for i in range(COUNT)]
    return Unknowns([Unknown(p.path, p, (0,), 0.0, -np.inf, np.inf, 1.0) for p in places])


def measured(seed=0, rows=ROWS):
    """Alike within a window and of uneven size: no rule but that of clusters holds."""
    rng = np.random.default_rng(seed)
    together = np.repeat(rng.normal(size=WINDOWS), rows // WINDOWS)
    return together + (0.3 + np.arange(rows) / rows) * rng.normal(size=rows)


def heavy(seed=1):
    """Noise with outliers."""
    return np.random.default_rng(seed).standard_t(2, size=ROWS)


def judged(estimate, target, slopes=SLOPES, loss=SQUARES, window=WINDOW):
    """Our covariance at an estimate of the level, the wave and the trend."""
    every = np.ones(len(target), dtype=bool)
    line = Series(0, "y", "y", every, estimate @ slopes - target, slopes, window)
    return covariance([line], unknowns(), loss, FREE)


def ours(target, slopes, loss):
    """Our own minimum of a loss of linear residuals."""

    def evaluate(points):
        found = []
        for u in points:
            r = u @ slopes - target
            weighted = loss.weighted(slopes, r)
            found.append(Local(float(loss.cost(r).sum()), weighted @ r, weighted @ slopes.T, 0))
        return found

    limits = Limits(
        np.full(COUNT, -np.inf),
        np.full(COUNT, np.inf),
        200,
        1,
        samples=len(target),
        reach=np.inf,
        tolerances=Tolerances(near=1e-10, noticeable=0.0),
    )
    (lane,) = descend(evaluate, np.zeros((1, COUNT)), limits)
    return lane.u


def test_independent_residuals_are_ols_but_for_the_parameters_taken_off():
    target = measured()
    theirs = sm.OLS(target, SLOPES.T).fit()
    found = judged(theirs.params, target)
    factor = np.sqrt(ROWS / (ROWS - COUNT))
    np.testing.assert_allclose(factor * found.independent, theirs.bse, rtol=1e-10)
    np.testing.assert_allclose(ours(target, SLOPES, SQUARES), theirs.params, rtol=1e-7, atol=1e-8)


def test_weights_are_those_of_wls():
    """A weight of statsmodels is one over the variance; residuals and slopes are divided by its root."""
    target, noise = measured(), np.linspace(0.2, 2.0, ROWS)
    theirs = sm.WLS(target, SLOPES.T, weights=noise**-2).fit()  # pyright: ignore[reportArgumentType]
    found = judged(theirs.params, target / noise, SLOPES / noise)
    np.testing.assert_allclose(np.sqrt(ROWS / (ROWS - COUNT)) * found.independent, theirs.bse, rtol=1e-10)
    clustered = theirs.get_robustcov_results("cluster", groups=WINDOW, use_correction=False)
    np.testing.assert_allclose(
        found.windows * np.sqrt((WINDOWS - COUNT) / WINDOWS), clustered.bse, rtol=1e-10
    )


def test_windows_are_clusters_with_another_factor_for_few():
    """Theirs: G/(G - 1) (n - 1)/(n - k), for large samples; ours: G/(G - k), as all windows were fitted."""
    target = measured()
    theirs = sm.OLS(target, SLOPES.T).fit(cov_type="cluster", cov_kwds={"groups": WINDOW})
    found = judged(theirs.params, target)
    usual = WINDOWS / (WINDOWS - 1) * (ROWS - 1) / (ROWS - COUNT)
    factor = np.sqrt(WINDOWS / (WINDOWS - COUNT) / usual)
    np.testing.assert_allclose(found.windows / factor, theirs.bse, rtol=1e-10)
    assert 1.03 < factor < 1.06


def test_our_factor_of_few_windows_is_nearer_the_jackknife():
    """CRV3, which leaves out one cluster after the other, is what simulations favour for few clusters."""
    few = np.arange(ROWS) // (ROWS // 8)
    ratios = []
    for seed in range(40):
        target = measured(seed)
        plain = sm.OLS(target, SLOPES.T).fit()
        usual, jackknife = (
            np.sqrt(np.diag(cov_cluster(plain, few, crv_type=kind))) for kind in ("cluster", "cluster-crv3")
        )
        ratios.append([judged(plain.params, target, window=few).windows / jackknife, usual / jackknife])
    mine, theirs = np.median(ratios, axis=(0, 2))
    assert abs(mine - 1) < abs(theirs - 1) and 0.8 < mine < 1.1


def test_the_only_window_is_clustered_in_parts():
    target = measured()
    groups = np.arange(ROWS) * PARTS // ROWS
    theirs = sm.OLS(target, SLOPES.T).fit(
        cov_type="cluster", cov_kwds={"groups": groups, "use_correction": False}
    )
    found = judged(theirs.params, target, window=np.zeros(ROWS, dtype=int))
    np.testing.assert_allclose(found.windows * np.sqrt((PARTS - COUNT) / PARTS), theirs.bse, rtol=1e-10)


@pytest.mark.parametrize(("loss", "norm"), [(Huber(), HuberT(1.345)), (Student(4.0), StudentT(c=1.0, df=4))])
def test_robust_losses_are_rlm_but_for_its_corrections(loss, norm):
    """Huber's H1 divides Σψ² by n - k and multiplies by K², K = 1 + k/n var ψ'/(mean ψ')²."""
    target = heavy()
    theirs = sm.RLM(target, SLOPES.T, M=norm).fit(cov="H1", update_scale=False, tol=1e-12, maxiter=500)
    size = theirs.scale
    found = ours(target / size, SLOPES / size, loss)
    np.testing.assert_allclose(found, theirs.params, rtol=1e-5, atol=1e-6)
    r = (target - theirs.params @ SLOPES) / size
    for our, their in ((loss.cost, norm.rho), (loss.weight, norm.weights), (loss.slope, norm.psi_deriv)):
        np.testing.assert_allclose(our(r), their(r), rtol=1e-12, atol=1e-14)
    slope = norm.psi_deriv(r)
    factor = (1 + COUNT / ROWS * slope.var() / slope.mean() ** 2) * np.sqrt(ROWS / (ROWS - COUNT))
    spread = judged(theirs.params, target / size, SLOPES / size, loss).independent
    np.testing.assert_allclose(factor * spread, theirs.bse, rtol=1e-10)


def test_the_size_of_residuals_is_hubers_second_proposal():
    values = heavy() * 3.0
    _, theirs = ProposalTwo(c=LIMIT, tol=1e-10, maxiter=500)(values, mu=np.zeros(1))
    assert float(Huber().size(values)) == pytest.approx(float(np.squeeze(theirs)), rel=1e-3)


def coloured(rows, seed=2):
    """An autoregression of second order."""
    white = np.random.default_rng(seed).normal(size=rows + 500)
    return np.asarray(lfilter([1.0], [1, -1.2, 0.5], white), dtype=np.float64)[500:]


@pytest.mark.parametrize("order", [1, 2, 7])
def test_burg_is_theirs_where_no_reading_is_missing(order):
    values = coloured(400)
    theirs, _ = theirs_burg(values, order, demean=False)
    found = burg(values[None], np.ones(1), np.ones(400, dtype=bool), range(order, order + 1))
    np.testing.assert_allclose(found.coefficients, theirs, rtol=1e-10, atol=1e-12)


def test_autocovariances_of_an_autoregression_are_theirs():
    noise = Autoregression(np.array([0.8, -0.5, 0.2]), 2.0)
    process = ArmaProcess(np.append(1.0, -noise.coefficients), [1.0])
    expected = process.acovf(60)
    np.testing.assert_allclose(noise.covariances(60), 2.0 * expected / expected[0], rtol=1e-9, atol=1e-12)


def test_autocovariances_with_gaps_are_means_over_the_pairs_that_are_there():
    values = coloured(500)
    counts = np.random.default_rng(3).random(500) < 0.7
    theirs = acovf(
        np.where(counts, values, np.nan), adjusted=True, demean=False, missing="conservative", nlag=8
    )
    np.testing.assert_allclose(autocovariance(values, counts, 8), theirs, rtol=1e-10)


@pytest.mark.parametrize("kernel", ["bartlett", "uniform"])
def test_coloured_noise_is_hac_in_a_long_recording(kernel):
    """Newey and West weigh products of scores by lag, we take the spectrum of the noise; both go to one."""
    rows = 60_000
    slopes = np.stack([np.ones(rows), np.sin(0.01 * np.arange(rows)), np.cos(2.5 * np.arange(rows))])
    target = coloured(rows)
    theirs = sm.OLS(target, slopes.T).fit(cov_type="HAC", cov_kwds={"maxlags": 80, "kernel": kernel})
    plain = sm.OLS(target, slopes.T).fit()
    every, residual = np.ones(rows, dtype=bool), target - plain.params @ slopes
    inverse = np.linalg.inv(slopes @ slopes.T)
    found = np.sqrt(np.diag(inverse @ coloured_meat(slopes, residual, every, inverse) @ inverse))
    np.testing.assert_allclose(found, theirs.bse, rtol=0.1)
    assert (found[:2] > 1.6 * plain.bse[:2]).all() and found[2] < plain.bse[2]
