"""Figure of a simulation: its readings, what was measured, units."""

import jax
import numpy as np
import pytest
from report.fake import recording

import jaxmuscle as jm
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import actuator_from_card


@pytest.fixture(scope="module")
def short() -> jm.Recording:
    """Half a second of the sample."""
    return recording().part(0, 250)


def test_readings_and_what_was_measured_in_units_of_the_right_size(short: jm.Recording) -> None:
    simulation = jm.simulate(actuator_from_card(short.card), short)
    drawn = simulation.plot(short)
    panels = {axes.get_ylabel(): axes for axes in drawn.axes}
    assert set(panels) == {"pressure [bar absolute]", "position [mm]"}
    measured, simulated = panels["position [mm]"].lines
    np.testing.assert_allclose(np.asarray(measured.get_ydata()), 1e3 * short.columns["position"], rtol=1e-12)
    np.testing.assert_allclose(
        np.asarray(simulated.get_ydata()), 1e3 * np.asarray(simulation.readings["position"])
    )
    np.testing.assert_allclose(np.asarray(simulated.get_xdata()), short.time)
    assert [len(axes.lines) for axes in simulation.plot().axes] == [1, 1]


def test_muscles_are_numbered() -> None:
    times = np.arange(0, 0.05, 2e-3)
    command = np.full((len(times), 2), 3e5)
    drawn = jm.simulate(jm.robot.robot_joint(inertia=0.64), command, times).plot()
    labels = [axes.get_ylabel() for axes in drawn.axes]
    assert labels[1:] == ["pressure 1 [bar absolute]", "pressure 2 [bar absolute]"] and "[°]" in labels[0]


@pytest.mark.slow
def test_what_cannot_be_drawn_is_told(short: jm.Recording) -> None:
    actuator, times = actuator_from_card(short.card), np.arange(20) * 2e-3
    simulation = jm.simulate(actuator, np.ones(20), times)
    with pytest.raises(InputError, match="expected a recording; got str"):
        simulation.plot("lift.csv")  # pyright: ignore[reportArgumentType]
    joint = jm.robot.robot_joint(inertia=0.64)
    other = jm.simulate(joint, np.full((20, 2), 3e5), times)
    with pytest.raises(InputError, match="expected a recording of the same rig"):
        other.plot(short)
    many = jax.vmap(lambda mass: jm.simulate(jm.replace(actuator, {"mass": mass}), np.ones(20), times))(
        np.array([5.0, 8.0])
    )
    with pytest.raises(InputError, match="many at once"):
        many.plot()
    assert "2 at once" in many._repr_html_()
