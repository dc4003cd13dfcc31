"""The README's Python runs, word for word, and does what the README says of it."""

import re
from pathlib import Path

import matplotlib
import numpy as np
import pytest

README = Path(__file__).parents[1] / "README.md"
BLOCKS = re.findall(r"^```python\n(.*?)^```", README.read_text(encoding="utf-8"), flags=re.M | re.S)


def run(block, folder, monkeypatch):
    """What the names of a block stand for at its end."""
    matplotlib.use("Agg")
    monkeypatch.chdir(folder)
    names = {}
    exec(compile(block, str(README), "exec"), names)
    return names


@pytest.mark.slow
def test_diagnosis_simulation_and_fit(tmp_path, monkeypatch, capsys):
    (block,) = [block for block in BLOCKS if "jm.diagnose" in block]
    names = run(block, tmp_path, monkeypatch)
    assert [effect.name for effect in names["diagnosis"].effects] == ["load_friction"]
    loaded = names["jm"].Diagnosis.load(tmp_path / "lift.json")
    assert repr(loaded) == repr(names["diagnosis"]) and loaded.fit.values == names["diagnosis"].fit.values
    assert {"pressure", "position"} <= set(names["predicted"].columns)
    assert "load_friction" in capsys.readouterr().out


@pytest.mark.slow
def test_gains_are_tuned(tmp_path, monkeypatch):
    (block,) = [block for block in BLOCKS if "jm.tune(" in block]
    names = run(f"import jaxmuscle as jm\n{block}", tmp_path, monkeypatch)
    (told,) = re.findall(r"held out: ([\d.]+) deg, then ([\d.]+) deg", block)
    tuned = names["tuned"]
    before, after = (
        np.rad2deg(judged.value("tracking")) for judged in (tuned.held_out_before, tuned.held_out_after)
    )
    # Where the method ends depends on rounding, which differs between processors.
    assert before == pytest.approx(float(told[0]), abs=0.02)
    assert after == pytest.approx(float(told[1]), abs=0.05)
    assert (tmp_path / "gains.toml").is_file()


def test_no_block_is_left_out():
    assert len(BLOCKS) == 2
