"""The stabilised Runge-Kutta method: order on a smooth problem, stability on a stiff one."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxmuscle.simulation.solvers import STAGES, ChebyshevRungeKutta, stages_of


def steps(solver, field, start, end, count):
    """Fixed steps from 0 to `end`."""
    term, width = diffrax.ODETerm(field), end / count

    def onward(state, begin):
        kept = solver.init(term, begin, begin + width, state, None)
        return solver.step(term, begin, begin + width, state, None, kept, made_jump=False)[0], None

    return jax.lax.scan(onward, jnp.asarray(start), jnp.arange(count) * width)[0]


def amplification(solver, product):
    """What one step of y' = -λ y makes of y = 1; `product` is λ times the step."""
    return float(steps(solver, lambda t, y, _: -product * y, 1.0, 1.0, 1))


@pytest.mark.parametrize(
    ("field", "start", "exact"),
    [
        (lambda t, y, _: -(y**2), 1.0, 1 / 3),
        (lambda t, y, _: jnp.cos(t) * y, 1.0, np.exp(np.sin(2.0))),
        (lambda t, y, _: jnp.array([[0.0, 1.0], [-1.0, 0.0]]) @ y, [1.0, 0.0], [np.cos(2.0), -np.sin(2.0)]),
    ],
    ids=["nonlinear", "time-dependent", "oscillator"],
)
def test_is_of_second_order(field, start, exact):
    coarse, fine = (
        np.abs(np.asarray(steps(ChebyshevRungeKutta(), field, start, 2.0, n)) - exact).max()
        for n in (100, 200)
    )
    assert coarse < 1e-3
    assert coarse / fine == pytest.approx(4, abs=0.15)


@pytest.mark.parametrize("product", np.linspace(0.1, 9.5, 12))
def test_is_stable_far_along_the_negative_axis(product):
    assert abs(amplification(ChebyshevRungeKutta(), product)) < 1


@pytest.mark.parametrize("product", [2.1, 5.0, 9.5])
def test_heun_is_not(product):
    assert abs(amplification(diffrax.Heun(), product)) > 1


def test_gives_way_where_the_docstring_says():
    assert abs(amplification(ChebyshevRungeKutta(), 9.8)) < 1 < abs(amplification(ChebyshevRungeKutta(), 9.9))


def test_decays_over_many_stiff_steps():
    end = steps(ChebyshevRungeKutta(), lambda t, y, _: -950.0 * (y - jnp.sin(t)), 5.0, 1.0, 100)
    assert float(end) == pytest.approx(np.sin(1.0), abs=2e-3)


@pytest.mark.parametrize("stages", [2, 3, STAGES, 7])
def test_nodes_are_the_times_of_the_stages(stages):
    """A field that is 1 makes every stage its own time, and the last one is the end of the step."""
    nodes = [stage.node for stage in stages_of(stages)]
    assert nodes == sorted(nodes)
    assert nodes[-1] == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("stages", [2, 3, 7])
def test_every_number_of_stages_is_of_second_order(stages):
    coarse, fine = (
        abs(float(steps(ChebyshevRungeKutta(stages), lambda t, y, _: -(y**2) + t, 1.0, 2.0, n)) - exact)
        for exact in [float(steps(diffrax.Dopri5(), lambda t, y, _: -(y**2) + t, 1.0, 2.0, 2000))]
        for n in (100, 200)
    )
    assert coarse / fine == pytest.approx(4, abs=0.2)


@pytest.mark.parametrize("stages", [4, 6, 8])
def test_stability_grows_with_the_square_of_the_stages(stages):
    # (2/3) (s² - 1) (1 - (2/15) ε) with damping ε = 2/13: Sommeijer, Shampine and Verwer, section 2.
    bound = 2 / 3 * (stages**2 - 1) * (1 - 2 / 15 * 2 / 13)
    factor = jax.vmap(lambda z: steps(ChebyshevRungeKutta(stages), lambda t, y, _: -z * y, 1.0, 1.0, 1))
    assert np.abs(factor(jnp.linspace(0, bound, 400))).max() <= 1 + 1e-12
    assert abs(float(factor(jnp.array([1.02 * bound]))[0])) > 1
