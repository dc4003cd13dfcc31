"""Moving pictures: geometry of the muscle, what moves, files, and what is told of input that cannot be."""

import base64
import dataclasses
import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from PIL import Image
from report.chromium import opened, read_until

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.actuators.elbow import Elbow
from jaxmuscle.actuators.joint import AbstractMuscleJoints, muscle_joints
from jaxmuscle.animation import scene
from jaxmuscle.animation.muscle_shape import draw_muscle, radius_at, turns
from jaxmuscle.components import McKibben, PressureRegulator
from jaxmuscle.components.mckibben import described_by_thread
from jaxmuscle.errors import InputError
from jaxmuscle.hysteresis.prandtl_ishlinskii import Envelope, ModifiedPrandtlIshlinskii

MAKE: Any = McKibben
MUSCLE: McKibben = MAKE(0.3, 0.007, math.radians(22), 1.3)


_MAKERS: Any = (Envelope, ModifiedPrandtlIshlinskii, PressureRegulator, Elbow)


def short(name: str) -> jm.Recording:
    """The first second or so of a sample."""
    return jm.read(jm.sample(name)).part(0, 600)


def elbow() -> Elbow:
    """An elbow that turns by about a radian at 3 bar."""
    envelope, model, regulator, machine = _MAKERS
    side = envelope(1.0, 1e-5, 0.0, 0.0)
    return machine(regulator(30.0, 0.8), model(side, side, 1e-2, 1e-5, 3e4, 3e-6, 0.0))


@pytest.mark.parametrize("muscle", [MUSCLE, described_by_thread(MUSCLE)])
@pytest.mark.parametrize("contraction", [0.0, 0.03, 0.08])
def test_a_thread_keeps_its_length_at_every_contraction(muscle: object, contraction: float) -> None:
    # b² = l² + (2πnr)²: the braid does not stretch.
    length, radius = 0.3 - contraction, radius_at(muscle, contraction)
    thread = math.hypot(length, 2 * math.pi * turns(muscle) * radius)
    assert thread == pytest.approx(0.3 / math.cos(math.radians(22)), rel=1e-9)


def test_the_muscle_is_drawn_at_its_length_and_radius() -> None:
    axes = Figure().add_subplot()
    draw_muscle(axes, MUSCLE, np.array([0.1, 0.2]), np.array([0.1, 0.2 + 0.25]), 0.5)
    bladder = next(patch for patch in axes.patches if isinstance(patch, Polygon))
    (left, low), (right, high) = bladder.get_xy().min(axis=0), bladder.get_xy().max(axis=0)
    assert (right - left) / 2 == pytest.approx(radius_at(MUSCLE, 0.05), rel=1e-6)
    assert (low, high) == pytest.approx((0.2, 0.45))
    (braid,) = (each for each in axes.collections if isinstance(each, LineCollection))
    inside = np.concatenate([path.vertices for path in braid.get_paths()])
    assert np.abs(inside[:, 0] - 0.1).max() <= radius_at(MUSCLE, 0.05) * (1 + 1e-9)


def test_pressure_colours_the_bladder() -> None:
    def colour(level: float) -> Any:
        axes = Figure().add_subplot()
        draw_muscle(axes, MUSCLE, np.zeros(2), np.array([0.3, 0.0]), level)
        return axes.patches[0].get_facecolor()

    assert colour(0.0) != colour(0.5) != colour(1.0) == colour(1.7)


def test_the_mass_is_where_the_recording_says() -> None:
    recording = short("lift")
    moving = jm.animate(recording)
    for time in (recording.time[0], recording.time[-1]):
        machine = moving.picture(float(time)).axes[0]
        tops = [box.get_y() + box.get_height() for box in machine.patches if isinstance(box, Rectangle)]
        lift = float(np.interp(time, recording.time, recording.columns["position"]))
        assert min(abs(top - lift) for top in tops) < 1e-9


def test_the_arm_has_the_angle_of_the_joint() -> None:
    recording = short("swing")
    time = float(recording.time[-1])
    machine = jm.animate(recording).picture(time).axes[0]
    angle = recording.columns["angle"][-1]
    slopes = [
        math.atan2(y[1] - y[0], x[1] - x[0])
        for x, y in (np.asarray(line.get_data()) for line in machine.lines)
        if len(x) == 2 and x[0] == y[0] == 0.0
    ]
    assert min(abs(slope - angle) for slope in slopes) < 1e-9


def pictures_differ(moving: jm.animation.Animation) -> bool:
    """Whether the first and the last picture show something different."""
    images = [np.asarray(image.convert("RGB"), dtype=int) for image in moving.images()]
    return bool(np.abs(images[0] - images[-1]).max() > 50)


@pytest.mark.parametrize("name", ["lift", "bench", "swing"])
def test_every_sample_moves(name: str) -> None:
    moving = jm.animate(short(name), frames=2)
    assert pictures_differ(moving)
    still = dataclasses.replace(moving, times=moving.times[[0, 0]])
    assert not pictures_differ(still)


@pytest.mark.slow
def test_a_simulation_moves_with_its_machine() -> None:
    times = np.arange(0, 0.4, 2e-3)
    command = 101325 + 3e5 * np.sin(4 * times) ** 2
    run = jm.simulate(elbow(), command, times)
    np.testing.assert_array_equal(run.command, command)
    assert pictures_differ(jm.animate(run, elbow(), frames=2))
    joint = jm.robot.robot_joint(inertia=0.64)
    pair = jm.simulate(joint, np.full((len(times), 2), 3e5), times)
    assert pictures_differ(jm.animate(pair, joint, frames=2))


def test_pictures_of_an_animation_are_those_of_single_instants() -> None:
    moving = jm.animate(short("lift"), frames=2)
    last = list(moving.images())[-1]
    drawing = moving.picture(float(moving.times[-1]))
    canvas = FigureCanvasAgg(drawing)
    canvas.draw()
    single = np.asarray(canvas.buffer_rgba(), dtype=int)[..., :3]
    differing = np.abs(np.asarray(last.convert("RGB"), dtype=int) - single).max(axis=-1) > 60
    assert differing.mean() < 2e-3  # fewer colours, and edges where curves lie under what moves


def test_files(tmp_path: Path) -> None:
    moving = jm.animate(short("lift"), speed=0.5, frames=4)
    page = moving.save(tmp_path / "lift.html").read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)
    assert found is not None
    data = json.loads(found[1])
    assert len(data["frames"]) == 4 and data["times"] == moving.times.tolist()
    assert base64.b64decode(data["frames"][0]).startswith(b"\x89PNG")
    span = moving.times[-1] - moving.times[0]
    assert data["pause"] == pytest.approx(1000 * span / 3 / 0.5, abs=1)
    with Image.open(moving.save(tmp_path / "lift.gif")) as gif:
        assert (getattr(gif, "n_frames", 0), gif.size) == (4, (740, 480))
    folder = moving.save(tmp_path / "new" / "frames")
    assert sorted(file.name for file in folder.iterdir()) == [f"{n:04d}.png" for n in range(4)]
    assert moving._repr_html_().startswith("<iframe srcdoc=")
    with pytest.raises(InputError, match=r"expected a name that ends in \.html or \.gif"):
        moving.save(tmp_path / "lift.mp4")
    with pytest.raises(InputError, match="cannot write"):
        moving.save(tmp_path / "lift.html" / "frames")


@pytest.mark.slow
def test_the_player_plays_and_pauses(tmp_path: Path) -> None:
    file = jm.animate(short("lift"), frames=5).save(tmp_path / "lift.html")
    with opened(file, viewport={"width": 400, "height": 700}) as shown:
        place = "() => Number(document.getElementById('place').value)"
        assert read_until(shown, place, lambda now: now > 0) > 0
        shown.get_by_role("button", name="pause").click()
        stopped = shown.evaluate(place)
        shown.wait_for_timeout(400)
        assert shown.evaluate(place) == stopped
        shown.locator("#place").focus()
        shown.keyboard.press("End")
        assert shown.evaluate(place) == 4
        assert shown.evaluate("() => document.documentElement.scrollWidth") <= 400


@pytest.mark.parametrize("name", ["lift", "bench", "swing"])
def test_a_rig_is_drawn_with_its_parameters(name: str) -> None:
    actuator = jm.actuator(short(name).card)
    machine, listed = jm.draw(actuator).axes
    told = {label.get_text() for label in listed.texts}
    assert {"muscle: initial length", "muscle: braid angle", "22°"} <= told
    assert any("α₀ = 22.0°" in label.get_text() for label in machine.texts)


def test_the_elbow_says_that_it_is_a_sketch() -> None:
    assert any("sketch" in label.get_text() for label in jm.draw(elbow()).axes[0].texts)


@pytest.mark.parametrize("rig", [*RIGS, "scara"])
def test_every_rig_of_the_package_has_a_scene(rig: str) -> None:
    assert scene.dispatch(RIGS[rig]) is not scene.dispatch(object)


def test_a_rig_of_ones_own_takes_a_scene() -> None:
    class Own(jm.actuators.Isotonic):
        rig = "own lift"

    lift: Any = jm.actuator(short("lift").card)
    own = Own(lift.valve, lift.muscle, lift.mass)
    assert scene(own).motion == "position"  # that of the rig it extends


def _made(kind: Any) -> Any:
    """A class whose fields' converters type checkers do not see."""
    return kind


def unseen() -> Any:
    """A rig that stands between two that have a scene and has none."""

    class Unseen(AbstractMuscleJoints):
        rig = "unseen"
        variables = muscle_joints(("command_1",), ("pressure_1",), ("angle",))
        available = frozenset[str]()

        regulator: PressureRegulator
        muscle: McKibben
        sprocket_radius: Any
        initial_contraction: Any
        ambient_pressure: Any = 101325.0
        effects: Any = None

        def signals(self, state: Any, held: Any) -> Any:
            raise NotImplementedError

        def vector_field(self, state: Any, held: Any) -> Any:
            raise NotImplementedError

    joint, made = jm.robot.robot_joint(inertia=0.64), _made(Unseen)
    return made(joint.regulator, joint.muscle, joint.sprocket_radius, joint.initial_contraction)


def test_what_cannot_be_shown_is_told() -> None:
    recording = short("lift")
    with pytest.raises(InputError, match="nothing is said of how rig 'unseen' looks; known: .*Isotonic"):
        jm.draw(unseen())
    with pytest.raises(InputError, match="expected a recording or a simulation; got str"):
        jm.animate("lift.csv")  # pyright: ignore[reportArgumentType]
    simulation = jm.simulate(jm.actuator(recording.card), recording)
    with pytest.raises(InputError, match="does not hold its machine"):
        jm.animate(simulation)
    with pytest.raises(InputError, match=r"no angle, pressure_1, pressure_2.*Is it a run of this machine\?"):
        jm.animate(simulation, jm.robot.robot_joint(inertia=0.64))
    bench = short("bench")
    driven = jm.actuator(bench.card)
    with pytest.raises(InputError, match="What a bench imposes is in the recording"):
        jm.animate(jm.simulate(driven, bench), driven)
    for speed in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(InputError, match="speed: expected"):
            jm.animate(recording, speed=speed)
    for frames in (1, 0, True, 2.5):
        with pytest.raises(InputError, match="frames: expected"):
            jm.animate(recording, frames=frames)  # pyright: ignore[reportArgumentType]
