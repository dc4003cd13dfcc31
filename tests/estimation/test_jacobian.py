"""Which numbers an output depends on, and slopes by those alone, against jacobians of the whole."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmuscle.estimation.jacobian import Traced, slopes_of

AT = jnp.array([0.3, 1.2, -0.7, 2.0])


def loops(values, _):
    """Two states in one loop, of which the second does not act on the first; one number acts on nothing."""
    a, b, c, _ = values

    def step(carry, x):
        first, second = carry
        return (first + a * x, second * b + first), first

    (_, second), path = jax.lax.scan(step, (jnp.zeros(()), c), jnp.arange(3.0))
    return [path, second]


def outputs(values, given):
    path, second = given
    return [path.sum() * values[3], jnp.where(values[0] > 0, second, 0.0)]


def test_what_acts_on_what():
    traced = Traced(loops, AT, [])
    np.testing.assert_array_equal(traced.acting, [[1, 0, 0, 0], [1, 1, 1, 0]])
    second = Traced(outputs, AT, traced(AT, []))
    np.testing.assert_array_equal(second.acting, [[0, 0, 0, 1], [1, 0, 0, 0]])
    np.testing.assert_array_equal(second.passing, [[1, 0], [0, 1]])
    np.testing.assert_array_equal(second.reached(list(traced.acting)), [[1, 0, 0, 1], [1, 1, 1, 0]])


@pytest.mark.slow
@pytest.mark.parametrize("compiled", [False, True])
def test_slopes_are_those_of_the_whole(compiled):
    def chained(values):
        hidden = slopes_of(Traced(loops, values, []), values, [], [], [])
        outer = Traced(outputs, values, hidden[0])
        return slopes_of(outer, values, *hidden)

    def plain(values):
        return outputs(list(values), loops(list(values), None))

    reached = []

    def dense(values):
        found, slopes, acts = chained(values)
        reached.extend(acts)
        columns = np.flatnonzero(np.any(acts, axis=0))
        return found, [jnp.zeros(4).at[columns].set(s) for s in slopes]

    found, slopes = (jax.jit(dense) if compiled else dense)(AT)
    np.testing.assert_allclose(found, plain(AT))
    np.testing.assert_allclose(slopes, jax.jacfwd(plain)(AT), rtol=1e-12)


def test_nothing_acts():
    traced = Traced(lambda values, given: [jnp.ones(3) * given[0]], AT, [jnp.ones(())])
    found, slopes, reached = slopes_of(traced, AT, [jnp.asarray(2.0)], [None], [np.zeros(4, dtype=bool)])
    np.testing.assert_array_equal(found[0], [2.0, 2.0, 2.0])
    assert slopes == [None] and not reached[0].any()


def test_many_sets_at_once():
    def row(values):
        found, slopes, _ = slopes_of(Traced(loops, values, []), values, [], [], [])
        return found[1], slopes[1]

    points = jnp.stack([AT, 2 * AT])
    second, slopes = jax.vmap(row)(points)
    exact = jax.vmap(jax.jacfwd(lambda v: loops(list(v), None)[1]))(points)
    assert slopes is not None
    np.testing.assert_allclose(slopes, exact[:, :3], rtol=1e-12)
    assert second.shape == (2,)
