"""What the data do not determine, in words."""

import numpy as np
import pytest

from jaxmuscle.estimation.identifiability import in_words, undetermined, without_influence

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
