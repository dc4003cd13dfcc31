"""The pane pushes, never pulls, and only where it is touched."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.bench import built

from jaxmuscle.components.contact import positive_part
from jaxmuscle.robot import Pane

PANE = built(Pane, stiffness=5e3, damping=3.0, normal=0.6, distance=0.5, width=1e-4)
NORMAL = np.array([np.cos(0.6), np.sin(0.6)])


def pressing(depth, speed, pane=PANE):
    return pane.pressing(jnp.asarray((0.5 + depth) * NORMAL), jnp.asarray(speed * NORMAL))


def test_is_a_linear_spring_at_rest():
    assert float(pressing(0.002, 0.0)) == pytest.approx(10.0)


def test_is_exactly_nothing_off_the_pane():
    assert float(pressing(-1.001e-4, 5.0)) == 0


@pytest.mark.parametrize("speed", [-5.0, -0.33, 0.0, 5.0])
@pytest.mark.parametrize("depth", [-1.0, -1e-4, 0.0, 5e-5, 0.01])
def test_never_pulls(depth, speed):
    assert float(pressing(depth, speed)) >= 0
    force = PANE.force(jnp.asarray((0.5 + depth) * NORMAL), jnp.asarray(speed * NORMAL))
    assert float(force @ NORMAL) <= 0
    assert float(force @ np.array([-NORMAL[1], NORMAL[0]])) == pytest.approx(0, abs=1e-12)


def test_takes_energy_from_a_bounce():
    # A mass of 1 kg that hits the pane at 0.5 m/s comes back slower; without damping as fast.
    def bounce(damping):
        pane = built(Pane, stiffness=5e3, damping=damping, normal=0.6, distance=0.5, width=1e-4)
        depth, speed, h = -1e-3, 0.5, 1e-5
        force = jax.jit(lambda depth, speed: pressing(depth, speed, pane))
        for _ in range(6000):
            speed -= 0.5 * h * float(force(depth, speed))
            depth += h * speed
            speed -= 0.5 * h * float(force(depth, speed))
            if depth < -1e-3:
                break
        return speed

    assert bounce(0.0) == pytest.approx(-0.5, rel=1e-3)
    assert -0.35 < bounce(3.0) < -0.1


def test_slopes_are_continuous_and_right():
    for depth in (-1e-4, 0.0, 1e-4, 3e-3):
        slope = jax.grad(pressing)(depth, -0.2)
        difference = (pressing(depth + 1e-9, -0.2) - pressing(depth - 1e-9, -0.2)) / 2e-9
        assert float(slope) == pytest.approx(float(difference), abs=0.05)
    leaves, tree = jax.tree.flatten(PANE)
    for depth, speed in [(-1.0, 0.0), (0.0, 0.0), (1e-4, -1 / 3)]:
        slopes = jax.grad(lambda x, d=depth, v=speed: pressing(d, v, jax.tree.unflatten(tree, x)))(leaves)
        assert np.isfinite(slopes).all()


def test_positive_part_joins_its_branches():
    x = jnp.array([-0.2, -0.1, 0.0, 0.1, 0.2])
    np.testing.assert_allclose(positive_part(x, 0.1), [0, 0, 0.025, 0.1, 0.2], atol=1e-16)
    np.testing.assert_allclose(
        jax.vmap(jax.grad(lambda v: positive_part(v, 0.1)))(x), [0, 0, 0.5, 1, 1], atol=1e-12
    )
