"""Bode plot and export of a linear model, held against python-control and closed forms."""

import builtins
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.analysis import LinearModel, equilibrium, linearise
from jaxmuscle.analysis.state_space import StateSpace, frequencies
from jaxmuscle.errors import InputError

OMEGA = np.geomspace(0.1, 1000, 40)


@pytest.fixture(scope="module")
def joint() -> LinearModel:
    """The joint of [T] about its middle."""
    machine = jm.robot.robot_joint(inertia=0.64)
    bare = machine.without_effects(*machine.effects)
    return linearise(bare, equilibrium(bare, np.full(2, 351e3)))


def response_of(model: LinearModel) -> np.ndarray:
    """At OMEGA, by NumPy."""
    a, b, c, d = (np.asarray(each) for each in (model.a, model.b, model.c, model.d))
    return StateSpace(a, b, c, d, model.states, model.inputs, model.outputs).response(OMEGA)


def first_order(tau: float) -> LinearModel:
    """3 / (τ s + 1)."""
    one = jnp.ones((1, 1))
    return LinearModel(-one / tau, one / tau, 3 * one, 0 * one, ("x",), ("u",), ("y",))


def test_bode_plot_of_a_first_order_lag() -> None:
    above, below = first_order(0.1).bode(omega=OMEGA).axes
    gain = 20 * np.log10(3 / np.sqrt(1 + (0.1 * OMEGA) ** 2))
    np.testing.assert_allclose(np.asarray(above.lines[0].get_ydata()), gain, atol=1e-9)
    np.testing.assert_allclose(
        np.asarray(below.lines[0].get_ydata()), -np.rad2deg(np.arctan(0.1 * OMEGA)), atol=1e-9
    )
    np.testing.assert_allclose(np.asarray(above.lines[0].get_xdata()), OMEGA)
    assert (above.get_ylabel(), below.get_xlabel()) == ("magnitude [dB]", "frequency [rad/s]")


def test_frequencies_hold_all_poles_and_an_integrator_does_not_count() -> None:
    grid = frequencies(np.diag([0.0, -2.0, -500.0]))
    assert (grid[0], grid[-1]) == pytest.approx((0.2, 5000.0))
    assert frequencies(np.zeros((1, 1)))[0] == pytest.approx(0.1)


def test_one_column_an_output_and_one_curve_an_input_that_acts(joint: LinearModel) -> None:
    drawn = joint.bode()
    assert len(drawn.axes) == 6
    counts = {axes.get_title(loc="left"): len(axes.lines) for axes in drawn.axes[:3]}
    assert counts["angle from command 1, command 2"] == 2
    assert counts["pressure 1 from command 1, command 2"] == 1  # the other regulator does not act on it
    assert len(joint.bode("angle", "command_2").axes) == 2


def test_the_response_is_that_of_the_compiled_one(joint: LinearModel) -> None:
    whole = response_of(joint)
    i, j = joint.outputs.index("angle"), joint.inputs.index("command_1")
    np.testing.assert_allclose(
        whole[:, i, j], joint.response(jnp.asarray(OMEGA), "angle", "command_1"), rtol=1e-9
    )


def test_python_control_gets_the_same_model(joint: LinearModel) -> None:
    control = pytest.importorskip("control", reason="python-control is not installed")
    system = joint.to_control()
    assert (system.input_labels, system.output_labels) == (list(joint.inputs), list(joint.outputs))
    assert system.state_labels == list(joint.states)
    np.testing.assert_array_equal(system.A, joint.a)
    poles = np.sort_complex(control.poles(system))
    np.testing.assert_allclose(poles, np.sort_complex(np.asarray(joint.poles())), atol=1e-6)
    answer = np.asarray(system(1j * OMEGA))
    np.testing.assert_allclose(np.moveaxis(answer, -1, 0), response_of(joint), rtol=1e-8, atol=1e-18)


def test_without_python_control_the_extra_is_named(
    joint: LinearModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = builtins.__import__

    def refused(name: str, *rest: Any) -> object:
        if name == "control":
            raise ImportError(name)
        return load(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refused)
    with pytest.raises(InputError, match=r"pip install 'jaxmuscle\[control\]'"):
        joint.to_control()


def test_what_cannot_be_drawn_is_told(joint: LinearModel) -> None:
    with pytest.raises(InputError, match="expected an output of"):
        joint.bode("torque")
    with pytest.raises(InputError, match="expected an input of"):
        joint.bode("angle", "voltage")
    with pytest.raises(InputError, match="frequencies above zero"):
        joint.bode(omega=np.array([0.0, 1.0]))
    many = jax.tree.map(lambda x: jnp.stack([x, x]), joint)
    with pytest.raises(InputError, match="many at once"):
        many.bode()
    with pytest.raises(InputError, match="many at once"):
        many.to_control()
    assert "2 at once" in many._repr_html_()
