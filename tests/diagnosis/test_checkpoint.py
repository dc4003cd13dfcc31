"""A diagnosis that was interrupted goes on with what was finished, and ends with the same numbers."""

import dataclasses
import json
import math
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.diagnosis import candidate_search
from jaxmuscle.diagnosis.settled_fit import SettledFit, as_record, from_record
from jaxmuscle.diagnosis.workbench import Workbench
from jaxmuscle.effects import LoadDamping, LoadFriction
from jaxmuscle.errors import InputError
from jaxmuscle.estimation.checkpoint import BEGINNING, NOTHING_KEPT, Checkpoint, NotResumed, checkpoint_at
from jaxmuscle.estimation.fingerprint import ORIGINS, digest, origin
from jaxmuscle.estimation.weights import Discrepancy
from jaxmuscle.optimization.descents import CONVERGED
from jaxmuscle.parameters import get, parameters, replace

MADE_FOR = dict.fromkeys(ORIGINS, "this")
AWKWARD = 0.1 + 0.2
"""A number that no short decimal is."""


@pytest.fixture(scope="module")
def model():
    return jm.actuator(jm.read(jm.sample("lift")).card)


def fitted(model, **values):
    moved = replace(model, values or {"muscle.end_factor": AWKWARD})
    left = {"position": [Discrepancy(2000, 1 / 3, 1.0), Discrepancy(7, math.inf, 2.5)]}
    return SettledFit(moved, AWKWARD, CONVERGED, left, 1 / 7, hopeful=False)


def opened(place, made_for=MADE_FOR, told=None):
    checkpoint = Checkpoint(place, (told if told is not None else []).append)
    checkpoint.open(made_for)
    return checkpoint


def recalled(checkpoint, model, of, fit=None):
    """What is recalled, and how often it was computed."""
    computed = []

    def compute():
        computed.append(True)
        return [fitted(model) if fit is None else fit]

    (found,) = checkpoint.recall(
        "settled",
        [of],
        lambda _: compute(),
        lambda fit: as_record(fit, model),
        lambda record: from_record(record, model),
    )
    return found, len(computed)


def values(fit):
    return {path: np.asarray(entry.value).tobytes() for path, entry in parameters(fit.model).items()}


def test_a_fit_comes_back_to_the_last_bit(tmp_path, model):
    place = tmp_path / "a.json"
    fit, computed = recalled(opened(place), model, 1)
    assert computed == 1
    again = opened(place)
    assert again.taken_over == 1
    back, computed = recalled(again, model, 1)
    assert computed == 0 and again.recalled == 1
    assert values(back) == values(fit) != values(SettledFit(model, 0.0, "", {}, 0.0))
    assert (back.cost, back.code, back.left, back.far) == (fit.cost, fit.code, fit.left, fit.far)
    assert back.converged and not back.hopeful
    assert recalled(again, model, 2)[1] == 1


def test_a_model_as_it_was_comes_back(tmp_path, model):
    fit = SettledFit(model, 1.0, CONVERGED, {}, math.nan)
    recalled(opened(tmp_path / "a.json"), model, 1, fit)
    back, computed = recalled(opened(tmp_path / "a.json"), model, 1)
    assert computed == 0 and values(back) == values(fit) and math.isnan(back.far)


def test_nothing_is_kept_unless_asked(model, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert [recalled(NOTHING_KEPT, model, 1)[1] for _ in range(2)] == [1, 1]
    with checkpoint_at(None, dict, silent, "fits") as checkpoint:
        recalled(checkpoint, model, 1)
    assert not list(tmp_path.iterdir())


def test_what_determines_a_fit_is_told_apart_to_the_last_bit(model):
    some = np.array([1.0, 2.0])
    last = np.nextafter(some, 3.0)
    different = [some, last, some[None], some.astype(np.float32), [1.0, 2.0], [1.0, [2.0]], [[1.0], 2.0],
                 {"a": some}, {"b": some}, "12", None, 12, model,
                 replace(model, {"mass": np.nextafter(float(get(model, "mass")), 99.0)}),
                 LoadFriction, LoadDamping, LoadFriction(), Discrepancy(3, 1.0, 1.0)]  # fmt: skip
    assert len({digest(each) for each in different}) == len(different)
    assert digest(some, model) == digest(some.copy(), replace(model, {"mass": float(get(model, "mass"))}))


def test_threads_share_a_file(tmp_path, model):
    place = tmp_path / "a.json"
    checkpoint = opened(place)
    gate = threading.Barrier(8)

    def work(i):
        gate.wait()
        return [recalled(checkpoint, model, j, fitted(model, mass=j + 1.0))[0] for j in (i, 8 + i, 99)]

    with ThreadPoolExecutor(8) as pool:
        for i, found in enumerate(pool.map(work, range(8))):
            assert [float(get(fit.model, "mass")) for fit in found] == [i + 1.0, i + 9.0, 100.0]
    again = opened(place)
    assert again.taken_over == 17
    assert float(get(recalled(again, model, 12)[0].model, "mass")) == 13.0
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_what_ends_after_an_interruption_is_not_written(tmp_path, model):
    place = tmp_path / "a.json"
    with (
        pytest.raises(KeyboardInterrupt),
        checkpoint_at(place, lambda: MADE_FOR, silent, "fits") as checkpoint,
    ):
        recalled(checkpoint, model, 1)
        raise KeyboardInterrupt
    before = place.read_bytes()
    recalled(checkpoint, model, 2)
    assert place.read_bytes() == before


def test_a_place_that_is_lost_on_the_way_is_told(tmp_path, model):
    checkpoint = opened(tmp_path / "a.json")
    tmp_path.rmdir()
    with pytest.raises(InputError, match=r"a\.json.*make its folder, or name another"):
        recalled(checkpoint, model, 1)


def silent(text):
    """Progress that goes nowhere."""


def test_a_diagnosis_that_ends_well_leaves_nothing(tmp_path, model):
    place, told = tmp_path / "a.json", []
    recalled(opened(place), model, 1)
    with checkpoint_at(str(place), lambda: MADE_FOR, told.append, "fits") as checkpoint:
        assert recalled(checkpoint, model, 1)[1] == 0
        recalled(checkpoint, model, 2)
    assert not list(tmp_path.iterdir())
    assert told == ["going on with 1 fits that are finished"]


def test_one_that_the_caller_made_is_the_callers_to_remove(tmp_path, model):
    given = Checkpoint(tmp_path / "a.json")
    with checkpoint_at(given, lambda: MADE_FOR, silent, "fits") as checkpoint:
        assert checkpoint is given
        recalled(checkpoint, model, 1)
    assert given.place is not None and given.place.exists()
    given.remove()
    given.remove()
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("part", ORIGINS)
def test_a_checkpoint_of_something_else_is_not_used_and_that_is_said(tmp_path, model, part):
    place, told = tmp_path / "a.json", []
    recalled(opened(place), model, 1)
    other = opened(place, {**MADE_FOR, part: "that"}, told)
    assert told == [f"{place}: it is of {ORIGINS[part]}; it is not used, and everything is computed anew"]
    assert other.taken_over == 0 and recalled(other, model, 1)[1] == 1
    assert opened(place, {**MADE_FOR, part: "that"}, told).taken_over == 1 and len(told) == 1


def cut(content):
    return content[:-20]


def altered(content):
    return content.replace(b"0.3000000", b"0.4000000")


def older(content):
    return content.replace(b'int": 2', b'int": 1')


def other_keys(content):
    return BEGINNING.encode() + b"2}"


def nothing(content):
    return b""


@pytest.mark.parametrize("damage", [cut, altered, older, other_keys, nothing])
def test_a_broken_checkpoint_is_not_used_and_that_is_said(tmp_path, model, damage):
    place = tmp_path / "a.json"
    recalled(opened(place), model, 1)
    content = damage(place.read_bytes())
    assert content != place.read_bytes()
    place.write_bytes(content)
    said = "it is of another version" if damage is older else "it is broken"
    with (
        pytest.warns(NotResumed, match=f"a.json: {said}.*not used"),
        checkpoint_at(place, lambda: MADE_FOR, silent, "fits") as checkpoint,
    ):
        assert recalled(checkpoint, model, 1)[1] == 1
        assert opened(place).taken_over == 1


def test_a_file_of_the_users_is_left_alone(tmp_path):
    place = tmp_path / "bench.csv"
    place.write_text("t_s,p_bar\n0,1\n")
    with pytest.raises(InputError, match=r"bench\.csv: it is no checkpoint .* name another file"):
        jm.diagnose(jm.read(jm.sample("lift")), resume=place)
    assert place.read_text() == "t_s,p_bar\n0,1\n"


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ("nowhere/a.json", "there is no folder"),
        ("", "expected a file; it is a folder"),
        (True, "expected the path of a file, or None; got bool"),
        (7, "got int"),
    ],
)
def test_a_place_that_is_none(tmp_path, monkeypatch, place, message):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=message):
        jm.diagnose(jm.read(jm.sample("lift")), resume=place)
    assert not list(tmp_path.iterdir())


def test_what_tells_a_diagnosis_from_others():
    recording = jm.read(jm.sample("lift"))
    first = origin([recording], [LoadFriction], (0.3, None))

    def differing(*arguments):
        return {part for part, value in origin(*arguments).items() if value != first[part]}

    assert first.keys() == ORIGINS.keys()
    assert differing([jm.read(jm.sample("lift"))], [LoadFriction], (0.3, None)) == set()
    assert differing([recording.part(1, None)], [LoadFriction], (0.3, None)) == {"recording"}
    heavier = dataclasses.replace(recording, card=recording.card.updated({"valve_area": (1e-6, 1e-8)}))
    assert differing([heavier], [LoadFriction], (0.3, None)) == {"card"}
    assert differing([recording], [LoadFriction], (0.3, {"position": np.arange(3) > 1})) == {"settings"}
    assert differing([recording], [LoadFriction, LoadDamping], (0.3, None)) == {"code", "settings"}


def test_code_of_ones_own_counts(tmp_path, monkeypatch):
    """An effect that is edited between two runs is another one."""
    file, module = tmp_path / "own_drag.py", ModuleType("own_drag")
    module.__file__ = str(file)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    own: Any = type("Drag", (), {"__module__": module.__name__})
    recording, found = jm.read(jm.sample("lift")), []
    for code in ("class Drag: ...\n", "class Drag: ...  # edited\n", "class Drag: ...\n"):
        file.write_text(code)
        found.append(origin([recording], [own], None)["code"])
    assert found[0] == found[2] != found[1]


CATALOGUE = (LoadFriction, LoadDamping)


def short():
    return jm.read(jm.sample("lift")).part(0, 1500)


def alike(first, second, at=""):
    """Whether two plain data are equal within rounding, but for the seconds they took."""
    if isinstance(first, dict):
        assert first.keys() == second.keys(), at
        return all(alike(first[k], second[k], f"{at}/{k}") for k in first if k != "seconds")
    if isinstance(first, list):
        assert len(first) == len(second), at
        return all(alike(a, b, f"{at}[{i}]") for i, (a, b) in enumerate(zip(first, second, strict=True)))
    if isinstance(first, float):
        assert second == pytest.approx(first, rel=1e-9, abs=1e-300), at
    else:
        assert first == second, at
    return True


@pytest.mark.slow
def test_an_interrupted_diagnosis_goes_on_where_it_was(tmp_path, monkeypatch):
    place, searched, fits = tmp_path / "lift.json", [], []
    search, fit = candidate_search._search, Workbench.fit

    def counted_search(bench, model, accepted, sought, *rest):
        searched.append((*accepted, sought.name))
        return search(bench, model, accepted, sought, *rest)

    def counted_fit(bench, *arguments):
        fits.append(arguments)
        return fit(bench, *arguments)

    monkeypatch.setattr(candidate_search, "_search", counted_search)
    monkeypatch.setattr(Workbench, "fit", counted_fit)

    def counts():
        found = sorted(searched), len(fits)
        searched.clear()
        fits.clear()
        return found

    whole = jm.diagnose(short(), catalogue=CATALOGUE, constants=False)
    every, most = counts()
    assert [each.name for each in whole.effects] == ["load_friction"]
    # The best of a round is searched twice, from the card's values, too.
    first_round, second_round = [("load_damping",), ("load_friction",)], [("load_friction", "load_damping")]
    assert [*dict.fromkeys(every)] == first_round + second_round

    judged = []

    def interrupt(progress):
        judged.append("judging" in progress.doing)
        if sum(judged) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        jm.diagnose(short(), catalogue=CATALOGUE, constants=False, resume=place, progress=interrupt)
    first, before = counts()
    assert [*dict.fromkeys(first)] == first_round
    assert [path.name for path in tmp_path.iterdir()] == ["lift.json"]

    again = jm.diagnose(short(), catalogue=CATALOGUE, constants=False, resume=place)
    rest, after = counts()
    assert [*dict.fromkeys(rest)] == second_round
    assert after < most - before + 4, "only what two threads had begun is made again"
    assert not list(tmp_path.iterdir())
    saved = []
    for diagnosis in (whole, again):
        diagnosis.save(tmp_path / "saved.json")
        saved.append(json.loads((tmp_path / "saved.json").read_text()))
    assert alike(*saved)
