"""The blind benchmark draws the same recordings again, goes on after an interruption, and counts rightly."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
import blind  # pyright: ignore[reportMissingImports]
import blind_recordings  # pyright: ignore[reportMissingImports]
from blind_cards import off_by  # pyright: ignore[reportMissingImports]
from blind_file import claimed, kept, key  # pyright: ignore[reportMissingImports]
from blind_ranges import (  # pyright: ignore[reportMissingImports]
    OUTSIDE,
    RANGES,
    RESTS_ON_FRICTION,
    SIZES,
    declared_of,
    offered,
    truth_of,
)
from blind_recordings import drawn, noise  # pyright: ignore[reportMissingImports]
from blind_shift import shift_left  # pyright: ignore[reportMissingImports]

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def row(truth, found, *, shift=10.0, verdict=None, value=1.0, std=0.1, after=1.0, bristles=0.0):
    """A line of the file, every parameter being 1 in truth."""
    effects = {name: {"p": 1e-6, "strength": [value, std]} for name in found}
    return {
        "seed": 0,
        "rig": "driven",
        "noise": "white",
        "truth": {name: {"strength": 1.0} for name in truth},
        "bristles": bristles,
        "shift": 2 * shift,
        "left": shift,
        "most": shift,
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


@pytest.fixture
def short(monkeypatch):
    """Recordings of a second or two: the oracles are in plain Python."""
    for rig, seconds in {"driven": 4.0, "isotonic": 1.0, "joint": 0.6, "jet-pipe": 0.3}.items():
        monkeypatch.setitem(blind_recordings.SECONDS, rig, seconds)


@pytest.mark.slow
@pytest.mark.parametrize("rig", RANGES)
def test_every_rig_gives_readings_for_the_columns_of_its_card(rig, short):
    one = drawn(2, rig, 1, True)
    assert list(one.recording.columns) == [name for name in one.recording.card.columns if name != "time"]
    assert len(one.truth) == 1 and np.isfinite(one.shift) and one.left == one.most
    assert all(np.isfinite(series).all() for series in one.recording.columns.values())


@pytest.mark.slow
def test_what_the_other_effect_can_take_over_is_not_of_its_own():
    """A pressure that reads 4 kPa too little, and a bladder whose threshold is free."""
    threshold = {"bladder_stiffness": {"stiffness": 400.0, "threshold_pressure": 2.5e4}}
    offset = {"sensor_offset": {"column": "pressure", "offset": -4e3}}
    both, alone = own_shares("driven", threshold | offset), own_shares("driven", offset)
    assert both["sensor_offset"] < 0.1 * alone["sensor_offset"]
    rubbing = {"thread_friction": {"static_coefficient": 0.015, "kinetic_coefficient": 0.08,
                                   "velocity_constant": 0.15}}  # fmt: skip
    both, alone = own_shares("driven", threshold | rubbing), own_shares("driven", rubbing)
    assert both["thread_friction"] > 0.8 * alone["thread_friction"] > 10


def own_shares(rig, truth):
    """What each of the true effects moves of its own, on the machine and the motion of a seed."""
    draw = np.random.default_rng(3)
    machine, motion = blind_recordings.machine_of(rig, draw), blind_recordings.MOTIONS[rig](draw)
    columns = blind_recordings.readings_of(rig, machine, truth, motion)
    stds = blind_recordings.stds_of(rig, {})
    shares = (blind_recordings.shift_of(n, rig, machine, {}, truth, stds, motion, columns) for n in truth)
    return {name: own for name, (_, own) in zip(truth, shares, strict=True)}


@pytest.mark.parametrize("rig", RANGES)
def test_every_effect_of_a_rig_has_a_size_and_the_friction_that_it_rests_on(rig):
    draw = np.random.default_rng(0)
    for name in RANGES[rig]:
        truth = truth_of(rig, [name], draw)
        assert set(truth[name]) & set(SIZES[name])
        declared = declared_of(rig, truth, draw)
        assert not set(declared) & set(truth)
        if name in RESTS_ON_FRICTION:
            assert "load_friction" in declared


def test_an_error_of_an_imposed_sensor_is_seen_where_it_leads_the_model_astray(short):
    """An offset of the pressure of a test machine is no change of its force, but of the force expected."""
    one = next(
        one
        for one in (drawn(seed, "driven", 1, False, ["sensor_offset"]) for seed in range(20))
        if one.truth["sensor_offset"]["column"] == "pressure"
    )
    offset = abs(one.truth["sensor_offset"]["offset"])
    clean = drawn(0, "driven", 0, False, ["sensor_offset"])
    assert clean.truth == {} and clean.shift == 0
    # At 14.1 π r0² of force per pressure at full length, less where it is contracted.
    assert 0.1 < one.shift * 0.8 / (offset * 14.1 * np.pi * 0.0075**2) < 1.0


def test_what_uncertain_parameters_take_over_is_not_to_be_found():
    t = np.linspace(0, 1, 200)
    noise = {"force": 0.5, "angle": 2.0}

    def readings(off):
        gain, offset = off.get("gain", 0.0), off.get("offset", 0.0)
        return {"force": 3 * t + 4.0 * gain * t, "angle": 5.0 * offset + 0 * t}

    def changed(force, angle):
        return {"force": 3 * t + force, "angle": angle + 0 * t}

    both = ["gain", "offset"]
    shift, left = shift_left(readings, both, changed(8.0 * t, 0.0), noise)
    assert shift == pytest.approx(16 * np.sqrt(np.mean(t**2))) and left < 0.02 * shift
    # Not as far as a parameter can be off, and not in a direction of its own.
    shift, left = shift_left(readings, both, changed(16.0 * t, 0.0), noise)
    assert left == pytest.approx(shift / 4, rel=1e-3)
    wave = np.sin(40 * t)
    shift, left = shift_left(readings, both, changed(wave, 0.0), noise)
    assert 0.97 * shift < left <= shift
    assert shift_left(readings, [], changed(wave, 0.0), noise) == (shift, shift)


def test_parameters_are_off_by_standard_deviations_of_the_card(short):
    one = drawn(3, "driven", 1, False, ["creep"])
    assert 0 < one.left <= one.shift
    off, stds = {"load_friction.force": 2.0}, {"end_factor": 0.05, "load_friction.force": 0.5}
    constants, effects = off_by({"end_factor": 1.3}, {"load_friction": {"force": 2.0}}, stds, off)
    assert constants == {"end_factor": 1.3} and effects == {"load_friction": {"force": 3.0}}


def test_a_third_of_all_benches_with_dry_friction_are_rough_the_clean_ones_too(short, monkeypatch):
    monkeypatch.setitem(blind_recordings.SECONDS, "joint", 0.03)
    bristles = [drawn(seed, "joint", 0, False).bristles for seed in range(60)]
    assert 12 <= sum(each > 0 for each in bristles) <= 28
    assert all(1e-4 <= each <= 6e-4 for each in bristles if each)
    assert not any(drawn(seed, "driven", 0, False).bristles for seed in range(20))


def test_only_names_that_were_asked_for_are_drawn(short):
    for seed in range(6):
        assert set(drawn(seed, "driven", 1, False, ["creep", "chamber_leak"]).truth) == {"creep"}
    one_effect = list(blind.tasks(30, ["driven", "isotonic", "joint"], ["chamber_leak"], only=True))
    assert {(rig, effects) for _, rig, effects, _ in one_effect} == {("isotonic", 1)}
    few = {effects for _, _, effects, _ in blind.tasks(60, ["driven"], ["creep"])}
    assert few == {0, 1}
    assert list(blind.tasks(5, ["driven"], ["gravity"])) == []


@pytest.mark.parametrize("rig", OUTSIDE)
def test_what_is_outside_the_catalogue_is_drawn_where_it_is_named(rig, short):
    assert not set(OUTSIDE[rig]) & {*RANGES[rig], *blind.SOUGHT} and offered(rig) == sorted(RANGES[rig])
    for name, ranges in OUTSIDE[rig].items():
        truth = truth_of(rig, [name], np.random.default_rng(2))
        assert set(truth[name]) - {"column"} == {*ranges} and {*ranges} & set(SIZES[name])
        assert blind.outside({"truth": truth}) == {name}
    one = drawn(1, rig, 1, False, ["reading_ripple"])
    assert [*one.truth] == ["reading_ripple"] and one.left > 0


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
        {"seed": 9, "rig": "driven", "noise": "white", "truth": {}, "left": 0.0, "refused": "too short"},
    ]
    counts = {f["figure"]: (f["count"], f["of"]) for f in blind.figures(rows)}
    assert list(counts.values()) == [(3, 3), (2, 3), (1, 2), (5, 6), (2, 3), (3, 4), (6, 7)]
    assert "gravity  gravity 2" in blind.confusion(rows)
    assert "0.3 to 1         0      1" in blind.detection(rows)
    assert [f["of"] for f in blind.figures(rows[:2])] == [2, 2, 1, 2]
    undetermined = row(["gravity"], ["gravity"], std=2.0)
    assert list(blind.coverage(undetermined)) == []


def test_what_is_not_sought_has_to_be_admitted():
    """Its name cannot be found; another one must not be."""
    admitted, misnamed = row(["stribeck"], []), row(["stribeck"], ["load_damping"])
    beside = row(["stribeck", "creep"], [])
    figures = {f["figure"]: (f["count"], f["of"]) for f in blind.figures([admitted, misnamed, beside])}
    assert figures["nothing named in place of what is not sought"] == (1, 2)
    assert not any("right" in name or "exactly" in name for name in figures)
    assert blind.outside(beside) == {"stribeck"}
    assert blind.outside(row(["sensor_offset", "presliding", "force_drift", "creep"], [])) == set()


def test_errors_of_sensors_go_by_the_column_and_bristles_are_on_a_rough_bench():
    off = {"sensor_offset": {"column": "pressure", "offset": 1.0}}
    right = row([], ["sensor_offset_pressure"]) | {"truth": off}
    wrong = row([], ["sensor_offset_position"]) | {"truth": off}
    right["found"]["sensor_offset_pressure"] = {"p": 1e-6, "offset": [1.05, 0.1]}
    assert blind.exact(right) and blind.first(right) in blind.there(right)
    assert not blind.exact(wrong) and blind.superfluous(wrong) == {"sensor_offset_position"}
    assert list(blind.coverage(right)) == [True] and list(blind.coverage(wrong)) == []
    assert blind.uncompared([right, wrong]) == ""
    assert (
        blind.uncompared([row(["gravity"], ["gravity"]) | {"truth": {"gravity": {"mass": 2.0}}}])
        == "gravity.mass"
    )
    rough, sharp = (row([], ["presliding"], bristles=b) for b in (1e-5, 0.0))
    assert not blind.superfluous(rough) and blind.superfluous(sharp)
    both = row(["creep"], ["presliding", "creep"], bristles=1e-5)
    assert blind.exact(both) and blind.first(both) == "creep"
    assert blind.first(row(["creep"], ["presliding", "creep"])) == "presliding"
    assert blind.first(row(["presliding"], ["presliding"], bristles=1e-5)) == "presliding"


def test_an_eccentric_sprocket_of_the_other_sign_is_the_same_half_a_turn_on():
    true = {"eccentricity": 0.02, "phase": 3.0, "wrap_angle": 1.0}
    found = {"p": 1e-6, "eccentricity": [-0.021, 0.001], "phase": [-0.1, 0.1], "wrap_angle": [1.1, 0.1]}

    def covered(phase, wrap=1.1):
        same = found | {"phase": [phase, 0.1], "wrap_angle": [wrap, 0.1]}
        both = {"truth": {"eccentric_sprocket": true}, "found": {"eccentric_sprocket": same}}
        return list(blind.coverage(row([], []) | both))

    assert covered(-0.1) == covered(-0.1 + 2 * np.pi) == [True, True, True]
    assert covered(3.0) == [True, False, True]
    assert covered(-0.1, 1.1 - 2 * np.pi) == [True, True, True]
    assert covered(-0.1, 1.1 - np.pi) == [True, True, False]


def test_shares_of_what_is_drawn():
    drawn_ones = list(blind.tasks(300, ["driven", "joint"]))
    effects = [effects for _, _, effects, _ in drawn_ones]
    assert effects.count(0) == pytest.approx(300 * blind.CLEAN_SHARE, abs=3)
    assert effects.count(2) == pytest.approx(300 * blind.PAIR_SHARE, abs=3)
    assert drawn_ones[:50] == list(blind.tasks(50, ["driven", "joint"]))
    assert drawn_ones[40:50] == list(blind.tasks(10, ["driven", "joint"], begin=40))


@pytest.fixture
def asked(monkeypatch):
    """What is diagnosed, by a diagnosis that costs nothing."""
    asked = []

    def diagnosed(drawing):
        asked.append(drawing[:4])
        told = {k: v for k, v in row([], []).items() if k not in ("seed", "rig")}
        colour = "coloured" if drawing[3] else "white"
        return told | {"noise": colour, "truth": {str(i): {} for i in range(drawing[2])}}

    monkeypatch.setattr(blind, "drawn", lambda *drawing: drawing)
    monkeypatch.setattr(blind, "diagnosed", diagnosed)
    return asked


def test_no_row_of_the_last_run_is_left_out():
    """Its figures stand in the documentation: rows of all successive seeds, as they are drawn by default."""
    rows = kept(BENCHMARKS / "blind_rows.jsonl")
    first = min(seed for seed, *_ in rows)
    drawn = blind.tasks(len(rows), list(RANGES), begin=first)
    assert {(seed, rig, n, "coloured" if c else "white", "") for seed, rig, n, c in drawn} == set(rows)


def test_an_interrupted_run_goes_on(tmp_path, asked):
    file = tmp_path / "deeper" / "blind.jsonl"
    assert len(blind.run(3, ["driven"], file)) == 3
    with file.open("a") as lines:
        lines.write(json.dumps({"seed": 3})[:-4])
    for _ in range(2):
        assert len(blind.run(5, ["driven"], file)) == 5
        assert len(asked) == 5
    # Of the same seeds, but drawn from other names.
    assert len(blind.run(5, ["driven"], file, ["creep"])) == 5
    assert len(asked) == 10 and len(kept(file)) == 10


def test_runs_that_fill_one_file_together_leave_each_other_alone(tmp_path, asked, capsys):
    file = tmp_path / "blind.jsonl"
    drawings = list(blind.tasks(4, ["driven"]))
    seed, rig, effects, coloured = drawings[1]
    busy = key(seed, rig, effects, "coloured" if coloured else "white")
    with claimed(file, busy) as mine:
        assert mine
        assert len(blind.run(4, ["driven"], file)) == 3
        assert drawings[1] not in asked and "1 of 4 recordings are left" in capsys.readouterr().out
    assert len(blind.run(4, ["driven"], file)) == 4 and asked[-1] == drawings[1]


def test_lines_of_several_processes_do_not_mix(tmp_path):
    file = tmp_path / "blind.jsonl"
    code = (
        f"import sys; sys.path.insert(0, {str(BENCHMARKS)!r}); from pathlib import Path;"
        "from blind_file import keep;"
        "[keep(Path(sys.argv[1]), {'seed': int(sys.argv[2]) + i, 'long': 'x' * 20000}) for i in range(20)]"
    )
    runs = [subprocess.Popen([sys.executable, "-c", code, file, str(begin)]) for begin in (0, 100)]
    assert [each.wait() for each in runs] == [0, 0]
    seeds = [json.loads(each)["seed"] for each in file.read_text().splitlines()]
    assert sorted(seeds) == [*range(20), *range(100, 120)]
