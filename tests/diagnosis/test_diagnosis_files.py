"""A diagnosis that was saved and loaded is the same, number by number."""

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd
import pytest
from report.fake import diagnosis, recording

import jaxmuscle as jm
from jaxmuscle.diagnosis import Diagnosis
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import actuator_from_card
from jaxmuscle.report.page import page


def same(one: Any, other: Any) -> bool:
    """Whether two results hold equal values of equal kinds; NaN equals NaN."""
    if isinstance(one, pd.DataFrame):
        return one.equals(other)
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, Mapping):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, jm.actuators.AbstractActuator):
        equal = jax.tree.map(lambda a, b: bool((a == b).all()), one, other)
        return type(one) is type(other) and all(jax.tree.leaves(equal))
    if dataclasses.is_dataclass(one):
        names = [field.name for field in dataclasses.fields(one) if field.compare]
        return type(one) is type(other) and all(same(getattr(one, n), getattr(other, n)) for n in names)
    if isinstance(one, float) and math.isnan(one):
        return math.isnan(other)
    return one == other


@pytest.fixture(scope="module")
def whole() -> Diagnosis:
    """An outcome with a real fit, and with values that are not finite."""
    found = diagnosis("effects found")
    actuator = actuator_from_card(recording().card)
    fitted = jm.fit(actuator, recording().part(0, 800), ["valve_area"])
    odd = dataclasses.replace(found.parameters["end_factor"], std=math.inf)
    traces = dataclasses.replace(
        found.traces, after={**found.traces.after, "pressure": np.full(6000, np.nan)}
    )
    parameters = {**found.parameters, "end_factor": odd}
    return dataclasses.replace(found, fit=fitted, parameters=parameters, traces=traces, horizon=None)


def test_everything_is_the_same_after_loading(whole: Diagnosis, tmp_path: Path) -> None:
    file = whole.save(tmp_path / "lift.json")
    loaded = Diagnosis.load(file)
    for field in dataclasses.fields(whole):
        assert same(getattr(whole, field.name), getattr(loaded, field.name)), field.name
    assert loaded.fit is not None and whole.fit is not None and loaded.fit.values == whole.fit.values
    assert repr(loaded) == repr(whole) and loaded.added == whole.added
    # Saved once more it is the same file.
    assert loaded.save(tmp_path / "again.json").read_bytes() == file.read_bytes()


@pytest.mark.parametrize("verdict", ["complete", "not confirmed", "unexplained"])
def test_the_page_of_a_loaded_one_is_the_same(verdict: str, tmp_path: Path) -> None:
    found = diagnosis(verdict)
    assert page(Diagnosis.load(found.save(tmp_path / "d.json"))) == page(found)


def test_a_recording_from_memory_and_a_card_that_is_sure_of_everything(tmp_path: Path) -> None:
    made = dataclasses.replace(recording(), file=None, sha256=None, breaks=(1000, 2000))
    found = dataclasses.replace(
        diagnosis("complete"), recording=made, parameters={}, correlations=pd.DataFrame(), rounds=()
    )
    loaded = Diagnosis.load(found.save(tmp_path / "d.json"))
    assert (loaded.recording.file, loaded.recording.breaks) == (None, (1000, 2000))
    assert loaded.correlations.empty and loaded.fit is None


def test_files_that_are_none_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no saved diagnosis"):
        Diagnosis.load(tmp_path / "none.json")
    (tmp_path / "text.json").write_text("no json", encoding="utf-8")
    with pytest.raises(InputError, match="cannot be read as JSON"):
        Diagnosis.load(tmp_path / "text.json")
    (tmp_path / "other.json").write_text('{"kind": "jaxmuscle fit"}', encoding="utf-8")
    with pytest.raises(InputError, match="not a diagnosis"):
        Diagnosis.load(tmp_path / "other.json")
    file = diagnosis("complete").save(tmp_path / "d.json")
    content = json.loads(file.read_text(encoding="utf-8")) | {"format": 99}
    file.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(InputError, match="diagnose again"):
        Diagnosis.load(file)
    with pytest.raises(InputError, match="cannot write"):
        diagnosis("complete").save(tmp_path / "no" / "folder" / "d.json")


def test_the_figure_shows_the_columns_that_are_predicted() -> None:
    found = diagnosis("effects found")
    both, one = found.plot(), found.plot("pressure")
    labels = [axes.get_ylabel() for axes in both.axes]
    assert "position [mm]" in labels and "pressure [bar]" in labels
    assert {axes.get_ylabel() for axes in one.axes} == {"pressure [bar]", "error [bar]"}
    with pytest.raises(InputError, match="'presure' is not predicted; did you mean 'pressure'"):
        found.plot("presure")
