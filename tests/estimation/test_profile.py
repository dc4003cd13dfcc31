"""Profile likelihoods: of nearly linear parameters, of undetermined ones, at bounds, out of time."""

import numpy as np
import pytest
from estimation.made import fitted, pulled


def test_profile_of_a_nearly_linear_parameter_is_its_interval(recording, result):
    found = fitted(recording, profiles=["end_factor"])
    (curve,) = found.profiles
    low, high = found.parameters["end_factor"].interval()
    assert (curve.lower, curve.upper) == pytest.approx((low, high), rel=1e-4)
    assert curve.deviance.min() == 0
    np.testing.assert_allclose(curve.deviance[[0, -1]], 9.0, rtol=0.1)


def test_profile_of_what_is_not_determined_is_open(recording):
    found = fitted(
        recording, "end_factor", "initial_length", profiles=["initial_length"], priors={"end_factor": None}
    )
    (curve,) = found.profiles
    assert curve.deviance.max() < 1.0
    assert (curve.lower, curve.upper) == (-np.inf, np.inf)


def test_a_profile_ends_at_a_bound(recording, result):
    """The bound is half a standard deviation above; the interval goes up to it and no farther."""
    bound = result.values["end_factor"] + 0.5 * result.std["end_factor"]
    found = fitted(recording, profiles=["end_factor"], bounds={"end_factor": (None, bound)})
    (curve,) = found.profiles
    assert curve.upper == bound == curve.values[-1]
    assert (np.diff(curve.values) > 0).all() and curve.missing == 0
    assert curve.lower == pytest.approx(result.parameters["end_factor"].interval()[0], rel=1e-4)
    np.testing.assert_array_equal(np.sign(curve.roots), [-1, -1, -1, 0, 1])
    figure = found.plot()
    drawn = next(a for a in figure.get_axes() if a.get_title(loc="left") == "end_factor")
    heights = np.asarray(drawn.lines[1].get_ydata())
    np.testing.assert_allclose(heights[[0, -1]], curve.deviance[[0, -1]], rtol=1e-9)


def test_a_profile_without_time_or_steps_has_no_points():
    """One that is only on its way would look too steep."""
    for how in ({"budget": 0.0}, {"steps": 1}):
        found = fitted(pulled(off=1.4, threads=True), profiles=["end_factor"], **how)
        (curve,) = found.profiles
        assert curve.missing == 6 and list(curve.values) == pytest.approx([found.values["end_factor"]])
        assert (curve.lower, curve.upper) == (-np.inf, np.inf)
        assert any("The profile of end_factor lacks 6 of its points" in note for note in found.notes())
        found.plot()
