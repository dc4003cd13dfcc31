"""The robot from files: card, table, machine, and a fit that is saved and read."""

import tomllib

import numpy as np
import pandas as pd
import pytest
from oracles import bench

import jaxmuscle as jm
from jaxmuscle.parameters import get
from jaxmuscle.recordings import Card
from jaxmuscle.robot import Scara, robot

STEP, FORCE = 4e-3, 0.25


@pytest.fixture(scope="module")
def recorded():
    """Two seconds of both joints, with noise, of a robot whose bearings rub."""
    times = np.arange(500) * STEP
    waves = [1e5 * np.sin(2 * np.pi * f * times + p) for f, p in ((0.8, 0.0), (1.1, 1.0))]
    command = bench.AMBIENT + 2.5e5 + np.stack([waves[0], -waves[0], waves[1], -waves[1]], axis=1)
    truth = robot(0.5).with_effects(load_friction=bench.built(jm.effects.LoadFriction, force=FORCE))
    readings = jm.simulate(truth, command, times, start={"pressure": command[0]}).to_frame()
    rng = np.random.default_rng(0)
    noise = {name: 400.0 if "pressure" in name else 4e-4 for name in readings}
    columns = {str(name): np.asarray(v) + rng.normal(0, noise[name], 500) for name, v in readings.items()}
    columns |= {f"command_{i + 1}": command[:, i] for i in range(4)}
    return jm.recording(robot(0.5), columns, STEP, noise=noise, horizon=1.0)


def test_card_and_table_are_read(recorded, tmp_path):
    card = Card.parse(tomllib.loads(recorded.card.to_toml()))
    assert card == recorded.card and card.rig == "scara"
    (tmp_path / "arm.toml").write_text(card.to_toml(), encoding="utf-8")
    pd.DataFrame({"time": recorded.time, **recorded.columns}).to_csv(tmp_path / "arm.csv", index=False)
    again = jm.read(tmp_path / "arm.csv")
    assert set(again.columns) == set(recorded.columns)
    np.testing.assert_allclose(again.columns["angle_2"], recorded.columns["angle_2"], rtol=1e-12)
    machine = jm.actuator(again.card)
    assert isinstance(machine, Scara)
    for name, path in Scara.quantities.items():
        assert float(get(machine, path)) == pytest.approx(float(get(robot(0.5), path)), rel=1e-12), name


@pytest.mark.slow
def test_a_fit_finds_the_friction_and_is_saved(recorded, tmp_path):
    start = robot(0.5).with_effects(load_friction=bench.built(jm.effects.LoadFriction, force=0.1))
    found = jm.fit(start, recorded, ["payload", "load_friction.force"])
    assert float(get(found.actuator, "effects.load_friction.force")) == pytest.approx(FORCE, rel=0.05)
    assert float(get(found.actuator, "arm.payload")) == pytest.approx(0.5, rel=0.05)
    found.save(tmp_path / "arm.json")
    again = jm.FitResult.load(tmp_path / "arm.json")
    assert isinstance(again.actuator, Scara)
    for path in ("arm.payload", "effects.load_friction.force", "arm.second.inertia"):
        assert float(get(again.actuator, path)) == float(get(found.actuator, path))
