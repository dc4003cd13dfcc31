"""A recording of the driven bench with a little noise, and its fit."""

import pytest
from estimation.made import fitted, pulled


@pytest.fixture(scope="module")
def recording():
    return pulled()


@pytest.fixture(scope="module")
def result(recording):
    return fitted(recording)
