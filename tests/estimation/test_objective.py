"""Points evaluated a few at a time, on all cores, come back as they were."""

import threading

import numpy as np
import pytest

from jaxmuscle.estimation.objective import divided


@pytest.mark.parametrize("points", [1, 2, 5, 8])
@pytest.mark.parametrize("width", [1, 2, 3])
def test_as_without_dividing(points, width):
    shapes = []

    def evaluate(some):
        shapes.append(some.shape)
        return some.sum(axis=1), some**2

    table = np.arange(points * 3.0).reshape(points, 3)
    total, squares = divided(evaluate, table, width)
    np.testing.assert_array_equal(total, table.sum(axis=1))
    np.testing.assert_array_equal(squares, table**2)
    # One shape: a compiled function is compiled once.
    assert set(shapes) == {(width, 3)} and len(shapes) == -(-points // width)


def test_an_error_in_a_part_is_not_lost():
    def evaluate(some):
        if threading.current_thread() is not threading.main_thread() and some[0, 0] > 0:
            raise ValueError("no")
        return (some,)

    with pytest.raises(ValueError, match="no"):
        divided(evaluate, np.array([[0.0], [1.0]]), 1)
