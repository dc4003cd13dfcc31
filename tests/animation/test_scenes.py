"""Scenes of the robot and of the jet pipe: geometry at rest and in a run, and what a run has to hold."""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.patches import Circle, Polygon, Rectangle
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.animation import scene
from jaxmuscle.animation.drawn_parts import CELL
from jaxmuscle.animation.jet_pipe_scene import PORT
from jaxmuscle.animation.joint_scenes import THICKER, reach_of
from jaxmuscle.animation.muscle_shape import radius_at
from jaxmuscle.errors import InputError
from jaxmuscle.figure_style import AFTER, INK
from jaxmuscle.robot import Pane, robot

TIMES = np.arange(0, 0.4, 2e-3)
TURN = math.radians(40), math.radians(-65)
"""Angles of the robot's joints [rad]."""


def drawn(actuator: Any, **now: float) -> Any:
    """Axes with the scene of a machine at rest, but for what is given."""
    seen = scene(actuator)
    moment = {**seen.rest, **now}
    axes = jm.draw(actuator).axes[0]
    axes.clear()
    seen.draw(axes, moment, dict.fromkeys(moment, 0.5))
    return axes


def links(axes: Any) -> list[np.ndarray]:
    """Begin and end of the robot's links."""
    return [each.get_xydata() for each in axes.lines if each.get_linewidth() == 6]


def roller(axes: Any) -> Circle:
    """What is drawn at the tip."""
    return [patch for patch in axes.patches if isinstance(patch, Circle)][-1]


def test_the_links_of_the_robot_have_its_lengths_and_angles() -> None:
    first, second = links(drawn(robot(), angle_1=TURN[0], angle_2=TURN[1]))
    elbow = 0.4 * np.array([math.cos(TURN[0]), math.sin(TURN[0])])
    tip = elbow + 0.4 * np.array([math.cos(sum(TURN)), math.sin(sum(TURN))])
    np.testing.assert_allclose(first, np.stack([np.zeros(2), elbow]), atol=1e-12)
    np.testing.assert_allclose(second, np.stack([elbow, tip]), atol=1e-12)


def test_the_muscles_of_the_robot_are_as_long_as_its_angles_say() -> None:
    machine = robot()
    axes = drawn(machine, angle_1=TURN[0], angle_2=TURN[1])
    # Bladders are the polygons of many corners; each runs from its fixed end to the one that moves.
    outlines = [p.get_xy() for p in axes.patches if isinstance(p, Polygon) and len(p.get_xy()) > 20]
    cosine, sine = math.cos(TURN[0]), math.sin(TURN[0])
    on_link = np.array([[cosine, -sine], [sine, cosine]])
    frames = [np.eye(2), np.eye(2), on_link, on_link]
    lengths = [np.ptp(outline @ frame, axis=0) for outline, frame in zip(outlines, frames, strict=True)]
    expected = []
    for angle in TURN:
        for side in (1, -1):
            contraction = 0.1 * 0.31 + side * 0.015 * angle
            expected.append([0.31 - contraction, 2 * THICKER * radius_at(machine.muscle, contraction)])
    np.testing.assert_allclose(lengths, expected, rtol=1e-3)


def test_the_tip_stays_within_the_reach_that_is_drawn() -> None:
    machine = robot()
    reach = reach_of(machine)
    limits = np.array(scene(machine).limits)
    assert (reach.min(axis=0) > limits[:, 0]).all() and (reach.max(axis=0) < limits[:, 1]).all()
    assert np.hypot(*reach.T).max() == pytest.approx(0.8)


def test_payload_and_pane_are_drawn_where_there_are_some() -> None:
    assert roller(drawn(robot())).get_facecolor() == Circle((0, 0), color=CELL).get_facecolor()
    loaded = drawn(robot(1.5))
    assert "1.5 kg" in {label.get_text() for label in loaded.texts}
    assert roller(loaded).get_facecolor() == Circle((0, 0), color=INK).get_facecolor()
    pane = Pane(*map(jnp.asarray, (1e4, 0.0, math.radians(90), 0.3)))
    beside = eqx.tree_at(lambda machine: machine.pane, robot(), pane)
    pressed = Circle((0, 0), color=AFTER).get_facecolor()
    hatched = lambda axes: [p for p in axes.patches if p.get_hatch()]  # noqa: E731
    (slab,) = hatched(drawn(beside))
    assert slab.get_xy()[:, 1].min() == pytest.approx(0.3) and hatched(loaded) == []
    assert roller(drawn(beside)).get_facecolor() != pressed
    assert roller(drawn(beside, angle_1=0.5)).get_facecolor() == pressed


def test_a_run_of_the_robot_moves() -> None:
    machine = robot(0.5)
    command = np.tile(101325 + np.array([4e5, 1e5, 1e5, 4e5]), (len(TIMES), 1))
    run = jm.simulate(machine, command, TIMES)
    moving = jm.animate(run, machine, frames=2)
    angles = np.asarray(run.readings["angle"])[-1]
    assert np.abs(angles).min() > 0.05
    tip = links(moving.picture(float(TIMES[-1])).axes[0])[1][1]
    np.testing.assert_allclose(tip, jm.robot.tip(machine.arm, jnp.asarray(angles)), atol=1e-9)
    assert [axes.get_title(loc="left") for axes in moving.picture(0.0).axes[1:3]] == [
        "angle 1 [°]",
        "angle 2 [°]",
    ]


@pytest.mark.parametrize("tip", [0.0, 4e-4, -3e-4])
def test_the_tip_of_the_pipe_lies_over_the_ports_as_its_position_says(tip: float) -> None:
    machine = bench.model("jet-pipe")
    axes = drawn(machine, pipe_2=tip)
    length, port = 0.07, 0.9652e-3
    (pipe,) = [p.get_xy() for p in axes.patches if isinstance(p, Polygon) and len(p.get_xy()) == 5]
    jet = pipe[2:4, 0]
    assert np.ptp(jet) == pytest.approx(PORT * length)
    white = [p for p in axes.patches if isinstance(p, Rectangle) and p.get_facecolor()[:3] == (1, 1, 1)]
    ports = sorted(
        p.get_x() + p.get_width() / 2 for p in white if p.get_width() == pytest.approx(PORT * length)
    )
    assert len(ports) == 2
    scale = np.diff(ports)[0] / (2 * port)
    # Port 1, to which a positive tip moves, is the one on the left.
    assert (np.mean(ports) - jet.mean()) / scale == pytest.approx(tip + 0.099e-3, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["jet-pipe", "jet-pipe-piston"])
def test_a_run_of_the_jet_pipe_shows_what_no_sensor_does(rig: str) -> None:
    machine = bench.model(rig)
    command = bench.piston_command() if machine.commands[1:] else bench.jet_pipe_command()
    times = np.arange(len(command)) * bench.STEPS[rig]
    run = jm.simulate(machine, command, times, states=True)
    moving = jm.animate(run, machine, frames=2)
    states: Any = run.states
    np.testing.assert_array_equal(moving.columns["pipe_2"], states["pipe"][:, 1])
    np.testing.assert_array_equal(moving.columns["pressure_2"], states["pressure"][:, 1])
    shown = moving.picture(0.45)
    told = {label.get_text() for label in shown.axes[0].texts}
    pressures = [np.interp(0.45, times, states["pressure"][:, i]) for i in range(2)]
    assert {f"chamber {i + 1}\n{p / 1e5:.2f} bar" for i, p in enumerate(pressures)} <= told
    assert "position of the tip [µm]" in {axes.get_title(loc="left") for axes in shown.axes[1:]}
    with pytest.raises(
        InputError, match=r"no (position, )?pipe_2, pressure_1, pressure_2, which.*states=True"
    ):
        jm.animate(jm.simulate(machine, command, times), machine)


def test_the_piston_is_where_the_run_says() -> None:
    axes = drawn(bench.model("jet-pipe-piston"), position=0.013)
    chambers = [p for p in axes.patches if isinstance(p, Rectangle) and p.get_zorder() == 2]
    assert [p.get_width() for p in chambers] == pytest.approx([0.013, 0.07 - 0.013])
    held = drawn(bench.model("jet-pipe"))
    chambers = [p for p in held.patches if isinstance(p, Rectangle) and p.get_zorder() == 2]
    assert chambers[0].get_width() == pytest.approx(0.048 - 0.026)


def test_states_are_shown_under_the_names_of_their_columns() -> None:
    recording = jm.read(jm.sample("bench")).part(0, 300)
    driven = jm.actuator(recording.card)
    kept: Any = jm.simulate(driven, recording, states=True)
    moving = jm.animate(kept, driven, frames=2)
    np.testing.assert_array_equal(moving.columns["position"], kept.states["contraction"])
    joint = jm.robot.robot_joint(inertia=0.64)
    command = np.full((len(TIMES), 2), 3e5)
    rates = jm.animate(jm.simulate(joint, command, TIMES, states=True), joint, frames=2)
    # The rate of a pressure is none: the colour is that of the highest pressure of the run.
    assert "pressure_rate_1" in rates.columns
    highest = rates.columns["pressure_1"].max()
    bladder = next(p for p in rates.picture(float(TIMES[-1])).axes[0].patches if isinstance(p, Polygon))
    level = (rates.columns["pressure_1"][-1] - 101325) / (highest - 101325)
    assert level == pytest.approx(1.0, abs=0.05)
    assert bladder.get_facecolor()[:3] == pytest.approx(tuple(np.array([0.85, 0.33, 0.12])), abs=0.05)
