"""A fit that was interrupted goes on with what was evaluated, and ends with the same numbers."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import jaxmuscle as jm
from jaxmuscle.cli import INTERRUPTED, app
from jaxmuscle.errors import InputError
from jaxmuscle.estimation import objective
from jaxmuscle.estimation.checkpoint import NotResumed
from jaxmuscle.estimation.objective import Objective

FREE = ["mass", "valve_area"]
SETTINGS = {"free": FREE, "starts": 2, "steps": 12, "noise": "estimated", "profiles": ["mass"]}


@pytest.fixture(scope="module")
def recording():
    return jm.read(jm.sample("lift")).part(0, 1200)


@pytest.fixture(scope="module")
def actuator(recording):
    return jm.actuator(recording.card)


@pytest.fixture
def evaluated(monkeypatch):
    """Numbers of points that were evaluated, call by call; the third number interrupts at that call."""
    found, own = [], Objective._evaluated
    limit = [10**9]

    def counted(self, points):
        if len(found) == limit[0]:
            raise KeyboardInterrupt
        found.append(len(points))
        return own(self, points)

    monkeypatch.setattr(Objective, "_evaluated", counted)
    return found, limit


def numbers(fit):
    """What a fit found, to the last bit."""
    return {
        "values": dict(fit.values),
        "std": {name: each.std for name, each in fit.parameters.items()},
        "cost": fit.cost,
        "profiles": [each.deviance.tobytes() for each in fit.profiles],
        "starts": [start.cost for start in fit.starts],
    }


@pytest.mark.slow
def test_it_ends_with_the_same_numbers_and_evaluates_no_point_twice(
    tmp_path, recording, actuator, evaluated, monkeypatch
):
    place, (points, limit) = tmp_path / "lift.json", evaluated
    monkeypatch.setattr(objective, "WRITTEN_EVERY", 0.0)
    whole = jm.fit(actuator, recording, **SETTINGS)
    calls, total = len(points), sum(points)
    assert calls > 10
    points.clear()
    limit[0] = calls // 2
    with pytest.raises(KeyboardInterrupt):
        jm.fit(actuator, recording, resume=place, **SETTINGS)
    first = sum(points)
    assert [path.name for path in tmp_path.iterdir()] == ["lift.json"]
    points.clear()
    limit[0], told = 10**9, []
    again = jm.fit(actuator, recording, resume=place, progress=told.append, **SETTINGS)
    # A point that is reached twice on the way is evaluated once only.
    assert sum(points) <= total - first
    assert told[0].startswith("going on with ") and told[0].endswith(" evaluations that are finished")
    assert numbers(again) == numbers(whole)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "said"),
    [({"seed": 1}, "other settings"), ({"loss": "huber"}, "other"), ({"free": ["mass"]}, "other settings")],
)
def test_a_checkpoint_of_another_fit_is_not_used(tmp_path, recording, actuator, evaluated, change, said):
    place, (points, limit) = tmp_path / "lift.json", evaluated
    limit[0] = 3
    with pytest.raises(KeyboardInterrupt):
        jm.fit(actuator, recording, resume=place, **SETTINGS)
    points.clear()
    with pytest.warns(NotResumed, match=f"it is of {said}"), pytest.raises(KeyboardInterrupt):
        jm.fit(actuator, recording, resume=place, **{**SETTINGS, **change})
    assert sum(points) > 0


def test_another_machine_is_another_fit(tmp_path, recording, actuator, evaluated):
    place, (_, limit) = tmp_path / "lift.json", evaluated
    limit[0] = 3
    with pytest.raises(KeyboardInterrupt):
        jm.fit(actuator, recording, resume=place, **SETTINGS)
    heavier = jm.replace(actuator, {"mass": 9.0})
    with pytest.warns(NotResumed, match="other settings"), pytest.raises(KeyboardInterrupt):
        jm.fit(heavier, recording, resume=place, **SETTINGS)


def test_what_is_between_two_writings_is_written_at_the_interruption(
    tmp_path, recording, actuator, evaluated, monkeypatch
):
    monkeypatch.setattr(objective, "WRITTEN_EVERY", 3600.0)
    place, (points, limit) = tmp_path / "lift.json", evaluated
    limit[0] = 5
    with pytest.raises(KeyboardInterrupt):
        jm.fit(actuator, recording, resume=place, **SETTINGS)
    assert len(json.loads(place.read_text())["kept"]) == sum(points)


def test_a_file_of_the_users_is_left_alone(tmp_path, recording, actuator):
    place = tmp_path / "bench.csv"
    place.write_text("t_s,p_bar\n0,1\n")
    with pytest.raises(InputError, match=r"bench\.csv: it is no checkpoint .* name another file"):
        jm.fit(actuator, recording, resume=place, **SETTINGS)
    assert place.read_text() == "t_s,p_bar\n0,1\n"


@pytest.mark.slow
def test_the_same_command_goes_on(tmp_path, evaluated, monkeypatch):
    monkeypatch.chdir(tmp_path)
    points, limit = evaluated
    command = ["fit", str(jm.sample("lift")), "--stretch", "0:2", "--starts", "1", "--resume"]
    limit[0] = 4
    outcome = CliRunner().invoke(app, command)
    assert outcome.exit_code == INTERRUPTED, outcome.output
    assert "the same command goes on where it was" in outcome.stderr
    assert [path.name for path in Path().iterdir()] == ["jaxmuscle-lift-fit.checkpoint.json"]
    kept = sum(points)
    points.clear()
    limit[0] = 10**9
    outcome = CliRunner().invoke(app, command)
    assert outcome.exit_code == 0, outcome.output
    assert f"going on with {kept} evaluations" in outcome.stderr
    assert sorted(path.name for path in Path().iterdir()) == ["jaxmuscle-lift-fit"]
