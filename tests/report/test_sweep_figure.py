"""The picture of a sweep: every point gets a cell of its own width."""

import numpy as np
import pytest

from jaxmuscle.report.sweep_figure import cell_edges


@pytest.mark.parametrize(
    ("numbers", "edges"),
    [
        ([1.0, 2.0, 3.0], [0.5, 1.5, 2.5, 3.5]),
        ([1.0, 2.0, 4.0, 5.0], [0.5, 1.5, 3.0, 4.5, 5.5]),
        ([0.1, 1.0, 10.0], 10.0 ** np.array([-1.5, -0.5, 0.5, 1.5])),
        (np.array([0.1, 1.0, 10.0]) * 1e-6, 10.0 ** np.array([-7.5, -6.5, -5.5, -4.5])),
        ([7.0], [6.5, 7.5]),
        ([3.0, 1.0], [4.0, 2.0, 0.0]),
    ],
)
def test_edges_lie_halfway_on_the_axis_that_is_drawn(numbers, edges):
    np.testing.assert_allclose(cell_edges(np.array(numbers)), edges)
