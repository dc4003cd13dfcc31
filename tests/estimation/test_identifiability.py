"""What the data do not determine, in words; losses; whiteness; coordinates and starts."""

import numpy as np
import pytest
from scipy.signal import lfilter

from jaxmuscle.estimation.identifiability import in_words, undetermined, without_influence
from jaxmuscle.estimation.losses import LOSSES, Huber, Loss, Squares, Student, loss_named
from jaxmuscle.estimation.names import Place
from jaxmuscle.estimation.series import Series
from jaxmuscle.estimation.starts import spread_starts
from jaxmuscle.estimation.unknowns import Unknown, Unknowns
from jaxmuscle.estimation.whiteness import independence, whiteness
from jaxmuscle.fitting.free import Prior

RNG = np.random.default_rng(0)
BASIS = RNG.normal(size=(3, 500))


def words(slopes, names, prior=None, logarithmic=None):
    """Sentences for sensitivities, one row a parameter."""
    slopes = np.array(slopes)
    prior = np.zeros(len(slopes)) if prior is None else np.array(prior)
    log = np.ones(len(slopes), bool) if logarithmic is None else np.array(logarithmic)
    return [each.words for each in undetermined(slopes @ slopes.T, prior, names, log)]


def test_everything_is_determined():
    assert words(BASIS, ["a", "b", "c"]) == []
    assert undetermined(np.zeros((0, 0)), np.zeros(0), [], np.zeros(0, bool)) == ()


def test_a_ratio():
    found = words([BASIS[0], -BASIS[0], BASIS[1]], ["valve_area", "dead_volume", "mass"])
    assert found == ["only valve_area / dead_volume is determined, not valve_area and dead_volume one by one"]


def test_a_product_and_a_power():
    assert words([BASIS[0], BASIS[0]], ["a", "b"]) == ["only a · b is determined, not a and b one by one"]
    assert words([BASIS[0], 2 * BASIS[0]], ["a", "b"])[0].startswith("only a · b^2 is determined")
    assert words([1.5 * BASIS[0], -BASIS[0]], ["a", "b"])[0].startswith("only a / b^(2/3) is determined")


def test_one_alone_and_two_directions_at_once():
    found = words([0 * BASIS[0], BASIS[0], -BASIS[0], BASIS[1]], ["leak", "area", "volume", "mass"])
    assert sorted(found) == [
        "leak is not determined by the data",
        "only area / volume is determined, not area and volume one by one",
    ]


def test_three_that_scale_together():
    slopes = [BASIS[0], BASIS[1], -BASIS[0] - BASIS[1]]
    (found,) = words(slopes, ["a", "b", "c"])
    assert found == "a, b and c are not determined one by one: the data allow to scale a · b · c together"


def test_shifts_of_what_may_be_negative():
    (found,) = words([BASIS[0], BASIS[0]], ["offset", "mass"], logarithmic=[False, True])
    assert found.endswith("the data allow to shift offset by +0.1 of its scale, mass by -10 %") or (
        found.endswith("the data allow to shift offset by -0.1 of its scale, mass by +10 %")
    )


def test_a_prior_decides_what_the_data_hardly_say():
    """The data know the parameter to 30 %; that is much without a prior, little beside one of 5 %."""
    weak = BASIS[0] / np.linalg.norm(BASIS[0]) / 0.3
    assert words([weak], ["a"]) == []
    assert words([weak], ["a"], prior=[1 / 0.05**2]) == [
        "the prior tells more of a than the data, whose own standard deviation is 30 %"
    ]
    shift = words([weak], ["a"], prior=[1 / 0.05**2], logarithmic=[False])
    assert shift[0].endswith("whose own standard deviation is 0.3 of its scale")


def test_what_the_data_do_determine_is_not_called_undetermined():
    """Data to a tenth of a percent beside priors that are sharper still."""
    strong = BASIS[0] / np.linalg.norm(BASIS[0]) / 1e-3
    weak = 1e-2 * BASIS[1] / np.linalg.norm(BASIS[1]) / 1e-3
    slopes = [strong + weak, -strong]
    (found,) = words(slopes, ["a", "b"], prior=[1e4, 1e4])
    assert found.startswith("the priors tell a and b apart better than the data, to which scaling a · b")
    assert "not determined" not in found
    (mixed,) = words(slopes, ["a", "b"], prior=[1e4, 1e4], logarithmic=[True, False])
    assert "to which shifting a by +10 %, b by +0.1 of its scale is one standard deviation" in mixed


def correlated():
    """Four parameters known to a tenth of a percent, all of whose errors go together."""
    mixing = np.eye(4) + 0.9 * np.random.default_rng(3).normal(size=(4, 4))
    rows = np.linalg.qr(np.random.default_rng(4).normal(size=(500, 4)))[0].T
    return 1e3 * mixing @ rows


def test_a_single_prior_tells_of_its_parameter_alone():
    """By the data's own standard deviation with the others unknown too, which is where its say ends."""
    slopes = correlated()
    information = slopes @ slopes.T
    std = np.sqrt(np.diag(np.linalg.inv(information)))
    given = 1 / np.sqrt(np.diag(information))
    assert (given < 0.8 * std).any()
    for i in range(4):
        for share, told in ((0.95, 1), (0.3, 1), (0.01, 1), (1.05, 0)):
            prior = np.where(np.arange(4) == i, 1 / (share * std[i]) ** 2, 0.0)
            found = undetermined(information, prior, list("abcd"), np.ones(4, bool))
            assert len(found) == told
            for each in found:
                assert each.exponents == {"abcd"[i]: 1.0} and each.std == pytest.approx(std[i])
                assert each.words.startswith(f"the prior tells more of {'abcd'[i]} than the data")


def test_no_more_is_told_than_there_are_priors():
    slopes = correlated()
    std = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    both = np.array([1.0, 0.0, 1.0, 0.0]) / (0.05 * std) ** 2
    found = words(slopes, list("abcd"), prior=both)
    assert [each.split(" than ")[0] for each in found] == [
        f"the prior tells more of {name}" for name in ("a", "c")
    ] or [each.split(" than ")[0] for each in found] == [
        f"the prior tells more of {name}" for name in ("c", "a")
    ]


def test_what_the_data_leave_open_takes_the_prior():
    """A prior on one of two that only scale together says nothing of what is known of their ratio."""
    slopes = [1e3 * BASIS[0], -1e3 * BASIS[0], 1e3 * BASIS[1]]
    found = words(slopes, ["a", "b", "c"], prior=[1e8, 0.0, 0.0])
    assert found == ["only a / b is determined, not a and b one by one"]
    # A second prior does: with both, the ratio.
    (_, ratio) = words(slopes, ["a", "b", "c"], prior=[1e12, 1e12, 0.0])
    assert ratio.startswith("the priors tell a and b apart better than the data, to which scaling a and inv")


def test_nothing_is_known():
    assert words([1e-3 * BASIS[0]], ["a"], prior=[1e4]) == ["a is not determined by the data"]


def test_a_hazy_direction_needs_no_prior_to_be_told():
    """Two that are known to a factor e together, no priors: each by itself a little better than that."""
    hazy = 0.84 / np.sqrt(2) * BASIS[0] / np.linalg.norm(BASIS[0])
    sharp = 1e3 * BASIS[1]
    assert words([hazy + sharp, hazy - sharp], ["a", "b"]) == [
        "only a / b is determined, not a and b one by one"
    ]


def test_weak_in_strong_company():
    """A direction a millionth as steep as another is still seen if it beats the noise."""
    slopes = [1e6 * BASIS[0], BASIS[1]]
    assert words(slopes, ["a", "b"]) == []


def test_without_influence():
    assert without_influence(np.array([[1.0, 2.0], [0.0, 0.0]]), ["a", "b"]) == ("b",)


def test_words_of_exponents():
    assert in_words({"x": 1.0, "y": 0.51}, {"x": True, "y": True}).startswith("only x / y^2 is determined")


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


def line(residual, counts=None):
    """A line of residuals."""
    counts = np.ones(len(residual), bool) if counts is None else counts
    kept = np.where(counts, residual, 0.0)
    return Series(0, "y", "y", counts, kept, np.zeros((1, len(residual))), np.zeros(len(residual), int))


def test_white_residuals_pass_as_often_as_they_should():
    rng = np.random.default_rng(1)
    passed = [whiteness(line(rng.normal(size=800)), "r").passed for _ in range(200)]
    assert 0.96 <= np.mean(passed) <= 1.0
    outside = [whiteness(line(rng.normal(size=800)), "r").outside for _ in range(50)]
    assert np.mean(outside) < 0.025


def test_coloured_residuals_do_not():
    series = lfilter([1.0], [1, -0.3], np.random.default_rng(1).normal(size=800))
    found = whiteness(line(series), "r")
    assert not found.passed and abs(found.correlation[0]) > found.band[0]


def test_residuals_that_follow_the_input():
    rng = np.random.default_rng(1)
    given = np.repeat(rng.normal(size=100), 10)
    residual = np.roll(given, 4) + rng.normal(size=1000)
    found = independence(line(residual), "r", "command", given)
    assert not found.passed
    assert found.lags[np.argmax(found.correlation)] == 4


def test_independent_residuals_pass_white_or_not():
    rng = np.random.default_rng(1)
    passed = []
    for _ in range(150):
        given = np.repeat(rng.normal(size=100), 10)
        residual = lfilter([1.0], [1, -0.8], rng.normal(size=1000))
        passed.append(independence(line(residual), "r", "command", given).passed)
    assert np.mean(passed) >= 0.95


def two(prior, **more):
    """A positive entry and one that may be negative."""
    area = Place("area", "area", 2e-6, "m^2", "", positive=True)
    shift = Place("shift", "shift", 0.0, "m", "")
    high = more.get("upper", np.inf)
    return Unknowns(
        [
            Unknown("area", area, (0,), 2e-6, 0.0, high, prior.std if prior else 1e-6, prior),
            Unknown("shift", shift, (0, 1), 0.0, -np.inf, np.inf, 1e-3),
        ]
    )


def test_coordinates_there_and_back():
    vector = two(Prior(1.8e-6, 3e-7))
    values = np.array([[1e-6, -2e-3], [5e-6, 4e-3]])
    np.testing.assert_allclose(vector.values(vector.coordinates(values)), values, rtol=1e-12)
    u, h = vector.coordinates(values[0]), 1e-6
    for i in range(2):
        step = h * np.eye(2)[i]
        slope = (vector.values(u + step) - vector.values(u - step))[i] / (2 * h)
        assert vector.slopes(u)[i] == pytest.approx(slope, rel=1e-6)
        prior = (vector.prior_residuals(u + step) - vector.prior_residuals(u - step))[i] / (2 * h)
        assert vector.prior_slopes[i] == pytest.approx(prior, rel=1e-6, abs=1e-9)
    assert vector.prior_residuals(vector.coordinates(np.array([1.8e-6, 1.0])))[0] == pytest.approx(
        0, abs=1e-9
    )
    np.testing.assert_array_equal(vector.acting_on(1), [1])


def test_starts_fill_the_prior_evenly():
    """One start in each of ten equal shares of the prior: that is what a Latin hypercube is."""
    vector = two(Prior(2e-6, 4e-7))
    points = spread_starts(vector, 11, seed=0)
    np.testing.assert_allclose(vector.values(points[0]), [2e-6, 0.0])
    logs = np.sort((points[1:, 0] - np.log(2e-6)) / 0.2)
    edges = np.array([-1.2816, -0.8416, -0.5244, -0.2533, 0.0, 0.2533, 0.5244, 0.8416, 1.2816])
    np.testing.assert_array_equal(np.searchsorted(edges, logs), np.arange(10))
    np.testing.assert_array_equal(points, spread_starts(vector, 11, seed=0))
    assert not np.array_equal(points, spread_starts(vector, 11, seed=1))


def test_starts_about_a_prior_of_mean_zero():
    place = Place("shift", "shift", 0.0, "m", "")
    vector = Unknowns([Unknown("shift", place, (0,), 0.0, -np.inf, np.inf, 2e-3, Prior(0.0, 2e-3))])
    values = vector.values(spread_starts(vector, 101, seed=0))[1:, 0]
    assert values.mean() == pytest.approx(0.0, abs=2e-4) and values.std() == pytest.approx(2e-3, rel=0.1)


def test_starts_keep_within_bounds():
    vector = two(Prior(2e-6, 2e-6), upper=2.5e-6)
    values = vector.values(spread_starts(vector, 40, seed=0))[:, 0]
    assert values.max() < 2.5e-6 and (values > 2.4e-6).sum() > 3
