"""`jaxmuscle tune`: a card and references in; gains, a report and commands out, all of them or none."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from oracles import bench
from typer.testing import CliRunner, Result

import jaxmuscle as jm
from jaxmuscle.cli import app
from jaxmuscle.cli.control_tasks import Task
from jaxmuscle.cli.starting_controllers import starting_controller
from jaxmuscle.cli.tuned_files import Request, tuned_files
from jaxmuscle.cli.tuning_scenarios import ScenarioMaker, machines
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import Card
from jaxmuscle.robot import robot
from jaxmuscle.samples import sample

Run = Callable[..., Result]
TIME = 0.004 * np.arange(150, dtype=np.float64)
SWING = sample("swing").with_suffix(".toml")
QUICK = ("--starts", "1", "--steps", "6", "--draws", "1")


def wave(file: Path, degrees: float, frequency: float) -> None:
    table = {"t_s": TIME, "theta_deg": degrees * np.sin(frequency * TIME)}
    pd.DataFrame(table).to_csv(file, index=False)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run the program in a folder with two references for a joint."""
    wave(tmp_path / "wave.csv", 12, 6)
    wave(tmp_path / "other.csv", 8, 9)
    monkeypatch.chdir(tmp_path)
    return lambda *arguments: CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.slow
def test_from_a_reference_to_gains_report_and_commands(run: Run, tmp_path: Path) -> None:
    outcome = run(
        "tune", SWING, "--controller", "pid", "--reference", "wave.csv", "--held-out", "other.csv",
        "--payload", "inertia=0.08,0.16", "--objective", "tracking=1", "--objective", "variation=40", *QUICK,
    )  # fmt: skip
    assert outcome.exit_code == 0, outcome.stderr
    folder = tmp_path / "jaxmuscle-swing-tune"
    assert sorted(p.name for p in folder.iterdir()) == ["commands.csv", "gains.toml", "report.html"]
    tuned = jm.tuning.Tuning.load(folder / "gains.toml")
    assert tuned.settings["objective"] == pytest.approx({"tracking": np.deg2rad(1), "variation": 40e5})
    assert list(tuned.after.terms.index) == [
        "wave, inertia 0.080 kg·m²", "wave, inertia 0.080 kg·m², machine 1",
        "wave, inertia 0.16 kg·m²", "wave, inertia 0.16 kg·m², machine 1",
    ]  # fmt: skip
    assert tuned.held_out_before is not None and tuned.held_out_after is not None
    assert list(tuned.held_out_after.terms.index) == [
        "other, inertia 0.080 kg·m², machine 2", "other, inertia 0.16 kg·m², machine 2",
    ]  # fmt: skip
    assert tuned.holds and tuned.held_out_after.value("tracking") < 0.5 * tuned.held_out_before.value(
        "tracking"
    )
    assert str(tuned) in outcome.stdout
    assert "iteration 1" in outcome.stderr and "iteration" not in outcome.stdout
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64,") == 1 and "scenarios that were held out" in page
    assert "gains guessed from the ranges of the rig" in page and "other, inertia" in page
    # Nothing is loaded from elsewhere, and the page forbids it.
    assert "://" not in page.replace("http://www.w3.org", "") and "default-src 'none'" in page

    # The commands are those of the loop: in open loop the machine of the card goes the same way.
    again = run(
        "simulate", SWING, "--command", folder / "commands.csv", "--output", "open.csv",
        "--start", "pressure_1=2.5", "--start", "pressure_2=2.5",
    )  # fmt: skip
    assert again.exit_code == 0, again.stderr
    closed, opened = pd.read_csv(folder / "commands.csv"), pd.read_csv("open.csv")
    np.testing.assert_allclose(opened["theta_deg"], closed["theta_deg"], atol=1e-4)
    np.testing.assert_allclose(closed["theta_deg_wanted"], 12 * np.sin(6 * closed["t_s"]), atol=1e-5)


@pytest.mark.slow
def test_own_gains_sample_time_and_start(run: Run) -> None:
    Path("corners.csv").write_text("t_s,theta_deg\n1,0\n1.1,5\n1.5,5\n1.6,0\n")
    outcome = run(
        "tune", SWING, "--reference", "corners.csv", "--sample-time", "0.006", "--draws", "0",
        "--out", "here",
        "--gain", "proportional=0.05:bar/deg", "--gain", "derivative=2e4", "--start", "angle=2",
        "--starts", "1", "--steps", "2", "--seed", "3", "--budget", "60",
    )  # fmt: skip
    assert outcome.exit_code == 0, outcome.stderr
    tuned = jm.tuning.Tuning.load("here/gains.toml")
    assert tuned.gains["proportional"].start == pytest.approx(0.05e5 / np.deg2rad(1))
    # A part that is not named is off, and stays so.
    assert set(tuned.gains) == {"proportional", "derivative"}
    assert tuned.settings["step"] == 0.006 and tuned.settings["seed"] == 3
    assert tuned.settings["budget"] == 60
    table = pd.read_csv("here/commands.csv")
    assert table["theta_deg"].to_list()[0] == pytest.approx(2)
    assert table["t_s"].to_list()[1] == pytest.approx(0.006)
    corners = np.interp(table["t_s"], [0, 0.1, 0.5, 0.6], [0, 5, 5, 0])
    np.testing.assert_allclose(table["theta_deg_wanted"], corners, atol=1e-9)
    # Nothing could be held out, and the report says so.
    assert tuned.holds is None and "Nothing was held out" in outcome.stdout
    assert "gains as they were given" in Path("here/report.html").read_text(encoding="utf-8")


def test_machines_are_drawn_as_the_card_is_unsure() -> None:
    card = Card.read(SWING)
    actuator = jm.actuator(card)
    some, others = machines(card, actuator, 4000, seed=1)
    assert len(some) == len(others) == 4000 and some[0] != others[0]
    assert set(some[0]) == {
        "regulator.frequency", "muscle.end_factor", "inertia",
        *(f"effects.thread_friction.{name}" for name in card.effects["thread_friction"]),
    }  # fmt: skip
    for name, path in (("inertia", "inertia"), ("end_factor", "muscle.end_factor")):
        given = card.uncertain[name]
        assert given.std is not None
        logarithms = np.log([machine[path] for machine in some])
        assert logarithms.mean() == pytest.approx(np.log(given.value), abs=4 * given.std / given.value / 60)
        assert logarithms.std() == pytest.approx(given.std / given.value, rel=0.05)
    again, _ = machines(card, actuator, 2, seed=1)
    assert again == machines(card, actuator, 2, seed=1)[0] != machines(card, actuator, 2, seed=2)[0]


def test_noise_and_payload_of_scenarios() -> None:
    card = Card.read(SWING)
    actuator = jm.actuator(card)
    inertia = jm.parameters.parameters(actuator)["inertia"]
    make = ScenarioMaker(actuator, card, 0.01, {}, {"inertia": (inertia, np.array([0.1, 0.2]))})
    made = make.scenarios({"up": (TIME + 5, 1.0 * TIME)}, [{}, {"inertia": 0.3, "muscle.end_factor": 1.2}], 7)
    assert [dict(s.changes) for s in made] == [
        {"inertia": 0.1}, {"inertia": 0.1, "muscle.end_factor": 1.2},
        {"inertia": 0.2}, {"inertia": 0.2, "muscle.end_factor": 1.2},
    ]  # fmt: skip
    assert [s.seed for s in made] == [7, 8, 9, 10]
    assert all(s.noise == {"pressure": 400.0, "angle": 4e-4} for s in made)
    np.testing.assert_allclose(made[0].reference, made[0].clock, atol=1e-12)
    assert made[0].clock[-1] == pytest.approx(0.59)


GIVEN = (SWING, "--reference", "wave.csv")
BAD = {
    "no card": (("absent.toml", "--reference", "wave.csv"), "no card 'absent.toml'"),
    "no reference": ((SWING, "--reference", "absent.csv"), "no reference 'absent.csv'"),
    "none at all": ((SWING,), "Missing option '--reference'"),
    "no held-out": ((*GIVEN, "--held-out", "absent.csv"), "no reference 'absent.csv'"),
    "other columns": ((SWING, "--reference", "volts.csv"), "column 'theta_deg' (angle): is not in the table"),
    "beyond reach": ((SWING, "--reference", "far.csv"), "within what the angle can reach"),
    "no channel": ((sample("bench").with_suffix(".toml"), "--reference", "wave.csv"), "no control channel"),
    "controller": ((*GIVEN, "--controller", "pidd"), "--controller: unknown 'pidd'; did you mean 'pid'?"),
    "payload": ((*GIVEN, "--payload", "inertia"), "--payload inertia: expected NAME=VALUE,VALUE"),
    "no payload": ((*GIVEN, "--payload", "inertja=1"), "unknown parameter 'inertja'; did you mean"),
    "payload of bars": ((*GIVEN, "--payload", "inertia=1:bar"), "got unit = 'bar'"),
    "negative payload": ((*GIVEN, "--payload", "inertia=-1"), "expected a value above zero; got -1"),
    "twice": ((*GIVEN, "--payload", "inertia=1", "--payload", "inertia=2"), "expected each name once"),
    "term": ((*GIVEN, "--objective", "trakking=1"), "unknown term 'trakking'; did you mean 'tracking'?"),
    "size": ((*GIVEN, "--objective", "tracking=-1"), "one size above zero"),
    "sizes": ((*GIVEN, "--objective", "tracking=1,2"), "one size above zero"),
    "size in bar": ((*GIVEN, "--objective", "tracking=1:bar"), "got unit = 'bar'"),
    "gain": ((*GIVEN, "--gain", "kp=1"), "--gain: unknown gain 'kp'"),
    "negative gain": ((*GIVEN, "--gain", "proportional=-1"), "expected proportional (gain K_p"),
    "gains": ((*GIVEN, "--gain", "proportional=1,2"), "one value"),
    "gain in bar": ((*GIVEN, "--gain", "proportional=1:bar"), "--gain proportional=1:bar: expected"),
    "start": ((*GIVEN, "--start", "angel=1"), "--start: unknown state 'angel'; did you mean 'angle'?"),
    "no sample time": ((SWING, "--reference", "corners.csv"), "not equally far apart"),
    "sample time": ((*GIVEN, "--sample-time", "-0.01"), "--sample-time: expected a time above zero"),
    "long": ((*GIVEN, "--sample-time", "0.5"), "at most half the reference, 0.298 s; got 0.5"),
    "draws": ((*GIVEN, "--draws", "-1"), "--draws: expected a number from 0 on; got -1"),
    "starts": ((*GIVEN, "--starts", "0", "--draws", "0"), "starts: expected"),
    "steps": ((*GIVEN, "--steps", "0", "--draws", "0"), "steps: expected"),
    "budget": ((*GIVEN, "--budget", "-1", "--draws", "0"), "budget: expected"),
    "seed": ((*GIVEN, "--seed", "-1"), "--seed: expected a number from 0 on; got -1"),
    "out": ((*GIVEN, "--out", "taken"), "is not a folder"),
    "no option": ((*GIVEN, "--nonsense"), "No such option"),
}  # fmt: skip


@pytest.mark.parametrize("why", BAD)
def test_bad_input_is_told_and_nothing_is_written(run: Run, tmp_path: Path, why: str) -> None:
    arguments, told = BAD[why]
    (tmp_path / "taken").write_text("")
    (tmp_path / "volts.csv").write_text("t_s,valve_V\n0,1\n1,2\n")
    (tmp_path / "corners.csv").write_text("t_s,theta_deg\n0,0\n0.1,5\n0.5,5\n")
    wave(tmp_path / "far.csv", 400, 6)
    before = sorted(p.name for p in tmp_path.iterdir())
    outcome = run("tune", *arguments)
    assert outcome.exit_code == 2, outcome.output
    assert told in " ".join(outcome.stderr.split()) and "Traceback" not in outcome.stderr
    assert outcome.stdout == "" and sorted(p.name for p in tmp_path.iterdir()) == before


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """The card of a robot, and a reference of its two joints beside it."""
    wanted = {"time": TIME, "angle_1": 0.2 * (1 - np.cos(5 * TIME)), "angle_2": 0.3 * np.sin(4 * TIME)}
    pd.DataFrame(wanted).to_csv(tmp_path / "both.csv", index=False)
    held = {f"command_{i + 1}": np.full(150, bench.AMBIENT + 2.5e5) for i in range(4)}
    held |= {f"pressure_{i + 1}": np.full(150, bench.AMBIENT + 2.5e5) for i in range(4)}
    columns = {**held, "angle_1": wanted["angle_1"], "angle_2": wanted["angle_2"]}
    recording = jm.recording(robot(0.5), columns, 0.004, noise={"angle_1": 4e-4})
    (tmp_path / "arm.toml").write_text(recording.card.to_toml(), encoding="utf-8")
    return tmp_path / "arm.toml"


@pytest.mark.thorough
def test_both_joints_of_a_robot_are_tuned_from_the_command_line(arm: Path, tmp_path: Path) -> None:
    request = Request(
        arm, "pid", [tmp_path / "both.csv"], payloads=["payload=0,1"], objective=["tracking=0.01"], draws=0,
        gains=["proportional=1e6", "joints[1].proportional=3e5"], starts=1, steps=3,
    )  # fmt: skip
    tuned, files = tuned_files(request, tmp_path / "here", lambda line: None)
    assert {name: gain.start for name, gain in tuned.gains.items()} == pytest.approx(
        {"joints[0].proportional": 1e6, "joints[1].proportional": 3e5}
    )
    assert tuned.after.cost < tuned.before.cost and len(tuned.after.terms) == 2
    trace = next(iter(tuned.traces.values()))
    assert [str(name) for name in trace][:4] == [
        "reference_1",
        "reference_2",
        "angle_1 before",
        "angle_2 before",
    ]
    table, wanted = pd.read_csv(files[2]), pd.read_csv(request.references[0])
    for name in ("angle_1", "angle_2"):
        np.testing.assert_allclose(table[f"{name}_wanted"], wanted[name], atol=1e-9)
        assert np.abs(table[name] - wanted[name]).max() < 0.5
    assert (table["command_1"] + table["command_2"]).to_numpy() == pytest.approx(2 * (bench.AMBIENT + 2.5e5))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("--controller", "sliding-mode"), "expected pid or fuzzy for each joint of rig 'scara'"),
        (("--gain", "joints[2].proportional=1"), "expected joints[0].NAME=… or joints[1].NAME=…"),
        (("--gain", "joints[1].kp=1"), "--gain: unknown gain 'kp'"),
    ],
)
def test_what_is_wrong_with_a_robots_controllers_is_told(run: Run, arm: Path, given, told: str) -> None:
    outcome = run("tune", arm, "--reference", "both.csv", *given)
    assert outcome.exit_code == 2 and told in " ".join(outcome.stderr.split()), outcome.stderr
    one = run("tune", arm, "--reference", "wave.csv")
    assert one.exit_code == 2 and "angle_1" in one.stderr


def test_a_rig_whose_commands_have_no_limit_asks_for_a_gain() -> None:
    """An elbow: nothing says how much pressure is much."""
    pid, task = starting_controller("pid"), Task(bench.model("elbow"), 1.0, 0.01)
    with pytest.raises(InputError, match=r"no limits to guess a gain from.*--gain proportional=…:Pa/rad"):
        pid.with_gains(task, [])
    given = pid.with_gains(task, ["proportional=2:bar/rad"])
    assert float(given.proportional) == pytest.approx(2e5)
    fuzzy = starting_controller("fuzzy").with_gains(task, ["proportional=2:bar"])
    assert float(fuzzy.proportional) == pytest.approx(2e5) and float(fuzzy.error_range) == 1.0
    # A reference that stays at zero says nothing of the size of errors either.
    still = Task(bench.model("joint"), 0.0, 0.01)
    with pytest.raises(InputError, match="the reference does not move.*--gain proportional"):
        pid.with_gains(still, [])
    sliding = starting_controller("sliding-mode")
    with pytest.raises(InputError, match="does not move.*--gain limit=…:Pa"):
        sliding.with_gains(
            still, ["per_error=1:bar/rad", "per_rate=1:bar s/rad", "integral_gain=1:bar/(rad s)"]
        )


BEGUN = {
    "feedforward": ["share", "feedback.proportional", "feedback.integral", "feedback.derivative"],
    "sliding-mode": ["slope", "curvature", "per_error", "per_rate", "integral_gain"],
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["feedforward", "lqg", "sliding-mode"])
def test_every_controller_of_a_joint_is_tuned_from_the_command_line(run: Run, name: str) -> None:
    outcome = run(
        "tune", SWING, "--controller", name, "--reference", "wave.csv", "--draws", "0", "--starts", "1",
        "--steps", "2", "--out", name,
    )  # fmt: skip
    assert outcome.exit_code == 0, outcome.stderr
    tuned = jm.tuning.Tuning.load(f"{name}/gains.toml")
    assert tuned.after.cost < tuned.before.cost < np.inf
    assert list(tuned.gains) == BEGUN.get(name, list(tuned.gains))
    assert (name == "lqg") == ("feedback[0]" in tuned.gains)
    table = pd.read_csv(f"{name}/commands.csv")
    np.testing.assert_allclose(table["theta_deg_wanted"], 12 * np.sin(6 * table["t_s"]), atol=1e-5)
    page = Path(name, "report.html").read_text(encoding="utf-8")
    assert ("designed on the linearised machine" in page) == (name == "lqg")


@pytest.mark.slow
def test_gains_of_other_controllers_may_be_given() -> None:
    joint = jm.actuator(Card.read(SWING))
    task = Task(joint, 0.3, 0.004)
    ahead = starting_controller("feedforward").with_gains(
        task, ["share=0.8", "feedback.proportional=1:bar/rad"]
    )
    assert float(ahead.share) == 0.8 and float(ahead.feedback.proportional) == 1e5
    assert float(ahead.feedback.integral) == 0.0
    sliding = starting_controller("sliding-mode").with_gains(task, ["slope=5"])
    assert float(sliding.slope) == 5.0
    designed = starting_controller("lqg").with_gains(task, ["integral=2e4"])
    assert float(designed.integral) == 2e4
    with pytest.raises(InputError, match="expected integral .* zero or above"):
        starting_controller("lqg").with_gains(task, ["integral=-1"])


@pytest.mark.parametrize(
    ("name", "rig", "told"),
    [
        ("fuzzy", "jet-pipe", "FuzzyPID turns an angle into a pressure: expected rig joint or elbow"),
        ("sliding-mode", "isotonic", "SlidingMode turns an angle into a pressure"),
        ("sliding-mode", "elbow", "no limits to guess a gain from"),
        ("force", "joint", "ProportionalForce turns .* expected rig jet-pipe"),
        ("feedforward", "isotonic", "does not rise with the output"),
        ("feedforward", "elbow", r"outputs=\(lowest, highest\)"),
    ],
)
def test_controllers_of_other_rigs_are_told(name: str, rig: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        starting_controller(name).with_gains(Task(bench.model(rig), 0.3, 0.004), [])
