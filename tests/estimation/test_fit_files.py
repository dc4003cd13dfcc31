"""A result saved, loaded, put on a card, drawn, fitted again."""

import dataclasses
import json
import tomllib

import equinox as eqx
import numpy as np
import pandas as pd
import pytest
from effects.own import Sleeve
from estimation.made import fitted, pulled

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.effects import BY_NAME
from jaxmuscle.estimation import Huber, Loss, Student
from jaxmuscle.estimation.fit_files import as_json
from jaxmuscle.estimation.serialization import as_toml, restored
from jaxmuscle.formatting import estimate


class Quartic(Loss):
    """A loss that no file can name."""

    def cost(self, r):
        """ρ(r)."""
        return r**4

    def weight(self, r):
        """ψ(r)/r."""
        return 4 * r**2

    def slope(self, r):
        """ψ'(r)."""
        return 12 * r**2


BAD = (np.arange(800) > 200) & (np.arange(800) < 260)


@pytest.fixture(scope="module")
def recordings():
    return [
        pulled(1, extra=3.0, threads=True, name="short"),
        pulled(2, extra=-4.0, threads=True, name="long"),
    ]


@pytest.fixture(scope="module")
def result(recordings):
    """With everything that a result can hold: a bound, a profile, an infinite deviation, a failed start."""
    return fitted(
        recordings,
        "end_factor",
        "initial_length",
        "thread_friction.kinetic_coefficient",
        per_recording=["offset.force"],
        bounds={"offset.force": (None, 2.0)},
        priors={"end_factor": None},
        starts=[{}, {"end_factor": 1e200}],
        masks=[None, {"force": BAD}],
        profiles=["thread_friction.kinetic_coefficient"],
        loss=Student(freedom=5.0),
    )


@pytest.fixture(scope="module", params=["fit.json", "fit.toml"])
def loaded(result, tmp_path_factory, request):
    return jm.FitResult.load(result.save(tmp_path_factory.mktemp("saved") / request.param))


def test_the_result_holds_all_kinds(result):
    assert result.parameters["offset.force[short]"].at_bound == "upper"
    assert result.failed and result.profiles and result.tests


def test_nothing_is_lost(result, loaded):
    assert json.loads(as_json(loaded)) == json.loads(as_json(result))
    assert list(loaded.parameters) == list(result.parameters)
    assert loaded.parameters == result.parameters
    assert loaded.starts == result.starts and loaded.noise == result.noise
    assert loaded.undetermined == result.undetermined and loaded.settings == result.settings
    assert loaded.cards == result.cards
    for one, other in zip(loaded.actuators, result.actuators, strict=True):
        assert eqx.tree_equal(one, other)
    pd.testing.assert_frame_equal(loaded.correlations, result.correlations)
    for name, table in result.predictions.items():
        pd.testing.assert_frame_equal(loaded.predictions[name], table)
    for one, other in zip(loaded.profiles, result.profiles, strict=True):
        np.testing.assert_array_equal(one.deviance, other.deviance)
    assert loaded.notes() == result.notes()


def test_the_file_is_strict_json(result):
    def refuse(text):
        raise AssertionError(f"{text} is no JSON")

    content = json.loads(as_json(result), parse_constant=refuse)
    entry = content["parameters"]["end_factor"]
    assert entry["value"] == result.values["end_factor"] and entry["unit"] == ""


def test_the_file_is_toml(result, tmp_path):
    content = tomllib.loads(result.save(tmp_path / "fit.toml").read_text(encoding="utf-8"))
    assert content["parameters"]["end_factor"]["value"] == result.values["end_factor"]
    (tmp_path / "fit.toml").write_text("kind = 'jaxmuscle fit")
    with pytest.raises(InputError, match="fit.toml: cannot be read as TOML"):
        jm.FitResult.load(tmp_path / "fit.toml")


@pytest.mark.parametrize("text", ['a "b" \\ c', "line\nbreak", "µ\x7f\x01", ""])
def test_any_text_survives_toml(text):
    content = {"a.b": text, "list": [None, True, 1e-300, 3, {text: [text]}], "table": {text: {"deep": None}}}
    assert restored(tomllib.loads(as_toml(content))) == content


def test_numbers_of_numpy_and_a_loss_of_ones_own(recordings, tmp_path):
    how = {"priors": {"end_factor": [np.float32(1.5), np.int64(1)]}, "loss": Huber(float(np.float32(2.0)))}
    found = fitted(recordings[0], "end_factor", steps=np.int64(9), seed=np.int64(3), **how)
    assert jm.FitResult.load(found.save(tmp_path / "fit.json")).settings == found.settings

    odd = dataclasses.replace(found, settings={**found.settings, "loss": Quartic()})
    with pytest.raises(InputError, match="with the loss Quartic cannot be saved: only squares, huber"):
        odd.save(tmp_path / "odd.json")


def test_fits_again_from_where_it_ended(result, loaded, recordings):
    again = loaded.refit(recordings, starts=1)
    assert again.cost == pytest.approx(result.cost, rel=1e-3)
    ratio = result.values["end_factor"] / result.values["initial_length"]
    assert again.values["end_factor"] / again.values["initial_length"] == pytest.approx(ratio, rel=1e-4)
    assert again.parameters["offset.force[long]"].upper == 2.0
    assert again.settings["loss"] == result.settings["loss"]
    # What was masked is masked again.
    assert again.samples == result.samples


@pytest.mark.slow
def test_goes_on_from_the_values_of_each_recording(result, loaded, recordings):
    again = loaded.refit(recordings[::-1], masks=None, steps=1)
    (start,) = again.starts
    assert start.start == pytest.approx({name: result.values[name] for name in start.start})
    assert set(start.start) == set(result.values)
    with pytest.raises(InputError, match="masks: expected a list with one mask .* for each of 1 recordings"):
        loaded.refit(recordings[0])
    alone = loaded.refit(recordings[0], masks=None, per_recording=[], bounds={}, steps=1)
    assert "offset.force" not in alone.values
    assert alone.starts[0].start["end_factor"] == pytest.approx(result.values["end_factor"])


@pytest.mark.parametrize("recording", ["short", "long", 0, -1])
def test_the_card_builds_the_fitted_machine(result, recording):
    card = result.to_card(recording)
    name = recording if isinstance(recording, str) else list(result.cards)[recording]
    assert eqx.tree_equal(jm.actuator(card), result.actuators[list(result.cards).index(name)])
    assert jm.Card.parse(tomllib.loads(card.to_toml())) == card
    assert f"offset.force[{name}]" in card.description and "not part of this card" in card.description
    kinetic = result.parameters["effects.thread_friction.kinetic_coefficient"]
    assert card.effects["thread_friction"]["kinetic_coefficient"].std == kinetic.std


def test_no_such_recording(result):
    with pytest.raises(InputError, match="the fit has no recording 'shor'; did you mean 'short'"):
        result.to_card("shor")
    with pytest.raises(InputError, match="the fit has 2 recordings; got number 5"):
        result.plot(5)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("{}", "not a fit; expected a file that FitResult.save"),
        ("[1", "cannot be read as JSON"),
        ('{"kind": "jaxmuscle fit", "format": 99, "jaxmuscle": "9.0"}', "written by jaxmuscle 9.0"),
    ],
)
def test_files_that_are_none(tmp_path, text, told):
    (tmp_path / "fit.json").write_text(text)
    with pytest.raises(InputError, match=told):
        jm.FitResult.load(tmp_path / "fit.json")
    with pytest.raises(InputError, match="no saved fit 'other.json'"):
        jm.FitResult.load(tmp_path / "other.json")


def test_nowhere_to_write(result, tmp_path):
    with pytest.raises(InputError, match="cannot write"):
        result.save(tmp_path / "absent" / "fit.json")


def test_an_effect_of_ones_own(recordings, tmp_path):
    """Without a name in files it is told in the card; registered, it is saved and declared as any other."""
    known = dict(BY_NAME)
    machine = jm.actuator(recordings[0].card).with_effects(own_sleeve=Sleeve(stiffness=1e4))  # pyright: ignore
    result = jm.fit(machine, recordings[0], ["own_sleeve.stiffness"], steps=3)
    with pytest.raises(InputError, match=r"cannot be saved: only registered .*jaxmuscle\.effects\.register"):
        result.save(tmp_path / "fit.json")
    told = f"effects.own_sleeve.stiffness = {result.values['effects.own_sleeve.stiffness']}"
    assert told in result.to_card().description and "own_sleeve" not in result.to_card().effects
    try:
        jm.effects.register(Sleeve)
        result.save(tmp_path / "fit.json")
        loaded = jm.FitResult.load(tmp_path / "fit.json")
        assert eqx.tree_equal(loaded.actuator, result.actuator)
        assert eqx.tree_equal(jm.actuator(result.to_card()), result.actuator)
    finally:
        BY_NAME.clear()
        BY_NAME.update(known)
    with pytest.raises(InputError, match="effect 'own_sleeve' is unknown; if it is your own, import and"):
        jm.FitResult.load(tmp_path / "fit.json")


@pytest.mark.parametrize("name", ["fit.json", "fit.toml"])
def test_the_file_is_as_readable_as_any_other(result, tmp_path, name):
    (tmp_path / "other").write_text("")
    assert result.save(tmp_path / name).stat().st_mode == (tmp_path / "other").stat().st_mode


def test_the_figure(result, tmp_path):
    figure = result.plot("long")
    figure.savefig(tmp_path / "fit.png", dpi=40)
    titles = {axes.get_title(loc="left") for axes in figure.get_axes()}
    assert "effects.thread_friction.kinetic_coefficient" in titles
    drawn = next(axes for axes in figure.get_axes() if axes.get_ylabel() == "force [N]")
    np.testing.assert_array_equal(
        drawn.lines[0].get_ydata(), result.predictions["long"]["force"].to_numpy(), strict=True
    )
    assert any(axes.get_title(loc="left") == "with pressure" for axes in figure.get_axes())


def test_the_figure_shows_the_range_of_the_readings(result):
    """A wide band hides nothing, and a column without readings is drawn empty."""
    table = result.predictions["long"]
    wide = {**result.predictions, "long": table.assign(**{"force std": 1e9})}
    drawn = next(a for a in dataclasses.replace(result, predictions=wide).plot("long").get_axes() if a.lines)
    low, high = drawn.get_ylim()
    assert low < table["force"].min() and table["force"].max() < high
    assert high - low < 1.5 * np.ptp(table["force"])
    empty = {**result.predictions, "long": table.assign(**{"force": np.nan, "force fitted": np.nan})}
    assert dataclasses.replace(result, predictions=empty).plot("long").get_axes()


def test_printed(result):
    """What is known of each value can be read without asking for more columns or a wider terminal."""
    lines, name = repr(result).split("\n"), "effects.thread_friction.kinetic_coefficient"
    kinetic = next(line for line in lines if line.startswith(name))
    assert estimate(result.values[name], result.std[name], "") in kinetic and " … " in kinetic
    assert lines[-len(result.notes()) :] == result.notes()
    assert all(any(line.startswith(name) for line in lines) for name in result.parameters)


def test_the_table(result):
    table = result.table()
    assert table.loc["offset.force[short]", "remark"] == "at its upper bound"
    assert list(table.columns[:5]) == ["value", "std", "low", "high", "unit"]
    kinetic = table.loc["effects.thread_friction.kinetic_coefficient"]
    assert kinetic["low"] < kinetic["value"] < kinetic["high"]
