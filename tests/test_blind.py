"""The blind benchmark draws the same recordings again, goes on after an interruption, and counts rightly."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import blind  # pyright: ignore[reportMissingImports]
from blind_recordings import RANGES, drawn, noise  # pyright: ignore[reportMissingImports]


def row(truth, found, *, shift=10.0, verdict=None, value=1.0, std=0.1, after=1.0):
    """A line of the file, every parameter being 1 in truth."""
    effects = {name: {"p": 1e-6, "strength": [value, std]} for name in found}
    return {
        "seed": 0,
        "rig": "driven",
        "noise": "white",
        "truth": {name: {"strength": 1.0} for name in truth},
        "shift": shift,
        "found": effects,
        "verdict": verdict or ("effects found" if found else "complete"),
        "before": {"force": 8.0},
        "after": {"force": after},
    }


def test_the_same_seed_gives_the_same_recording_and_another_another():
    one, again, other = (drawn(seed, "driven", 1, False) for seed in (4, 4, 5))
    np.testing.assert_array_equal(one.recording.columns["force"], again.recording.columns["force"])
    assert one.truth == again.truth != other.truth
    assert one.shift > 0 and set(one.truth) <= set(RANGES["driven"])
    assert drawn(4, "driven", 0, True).shift == 0


def test_coloured_noise_is_half_white_and_half_slow():
    white, coloured = (noise(20_000, 0.01, c, np.random.default_rng(3)) for c in (False, True))
    assert np.std(white) == pytest.approx(1.0, rel=0.02)
    assert np.std(np.diff(coloured)) == pytest.approx(np.sqrt(2), rel=0.15)
    assert np.std(coloured) == pytest.approx(np.sqrt(2), rel=0.15)
    assert np.std(coloured.reshape(-1, 10).mean(axis=1)) > 2 * np.std(white.reshape(-1, 10).mean(axis=1))


def test_figures():
    rows = [
        row([], []),
        row([], ["creep"], after=9.0),
        row(["gravity"], ["gravity"]),
        row(["gravity"], ["gravity"], value=1.4),
        row(["gravity", "creep"], ["creep"]),
        row(["gravity"], [], shift=0.5),
        {"seed": 9, "rig": "driven", "noise": "white", "truth": {}, "shift": 0.0, "refused": "too short"},
    ]
    counts = {f["figure"]: (f["count"], f["of"]) for f in blind.figures(rows)}
    assert list(counts.values()) == [(3, 3), (2, 3), (1, 2), (5, 6), (2, 3), (3, 4), (6, 7)]
    assert "gravity  gravity 2" in blind.confusion(rows)
    assert "0.3 to 1         0      1" in blind.detection(rows)
    undetermined = row(["gravity"], ["gravity"], std=2.0)
    assert list(blind.coverage(undetermined)) == []


def test_shares_of_what_is_drawn():
    drawn_ones = list(blind.tasks(300, ["driven", "joint"]))
    effects = [effects for _, _, effects, _ in drawn_ones]
    assert effects.count(0) == pytest.approx(300 * blind.CLEAN_SHARE, abs=3)
    assert effects.count(2) == pytest.approx(300 * blind.PAIR_SHARE, abs=3)
    assert drawn_ones[:50] == list(blind.tasks(50, ["driven", "joint"]))


def test_an_interrupted_run_goes_on(tmp_path, monkeypatch, capsys):
    asked = []

    def diagnosed(recording):
        asked.append(recording)
        return {k: v for k, v in row([], []).items() if k not in ("seed", "rig")} | {"noise": recording[3]}

    monkeypatch.setattr(
        blind, "drawn", lambda *drawing: (*drawing[:3], "coloured" if drawing[3] else "white")
    )
    monkeypatch.setattr(
        blind, "diagnosed", lambda b: diagnosed(b) | {"truth": {str(i): {} for i in range(b[2])}}
    )
    file = tmp_path / "deeper" / "blind.jsonl"
    assert len(blind.run(3, ["driven"], file)) == 3
    with file.open("a") as lines:
        lines.write(json.dumps({"seed": 3})[:-4])
    for _ in range(2):
        assert len(blind.run(5, ["driven"], file)) == 5
        assert len(asked) == 5
