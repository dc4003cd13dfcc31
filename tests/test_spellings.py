"""Every argument that takes the name of a parameter takes each of its names, or says which to write."""

import dataclasses
import functools
import pickle
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import bench
from report.fake import diagnosis

import jaxmuscle as jm
from jaxmuscle.actuators import RIGS
from jaxmuscle.cli.swept_files import axis, commanded
from jaxmuscle.cli.tuned_files import _payloads
from jaxmuscle.errors import UnknownNameError
from jaxmuscle.estimation.parameter_layout import layout
from jaxmuscle.estimation.prepare import asked_for, begun_at, profiled
from jaxmuscle.parameter_names import ByName, card_name, resolve, spelled
from jaxmuscle.parameters import describe, get, known_names, parameters, path_of, replace
from jaxmuscle.recordings import Card
from jaxmuscle.recordings.draft import draft_card
from jaxmuscle.recordings.read import table_in_file
from jaxmuscle.sweeps.operating_points import points_of
from jaxmuscle.sweeps.scenario import bench_of
from jaxmuscle.tuning import Scenario
from jaxmuscle.tuning.cases import _changes
from jaxmuscle.tuning.gains import gains_of

TEXT = jm.sample("lift").with_suffix(".toml").read_text(encoding="utf-8")
CARD = Card.from_toml(TEXT)
MACHINE = jm.actuator(CARD).with_effects(load_friction=jm.effects.LoadFriction(force=jnp.asarray(14.0)))
FREE = ["valve_area", "end_factor", "mass", "load_friction.force"]
SPELLINGS = {
    "valve_area": ("valve_area", "valve.area", "area"),
    "end_factor": ("end_factor", "muscle.end_factor"),
    "mass": ("mass", "load.mass"),
    "effects.load_friction.force": ("effects.load_friction.force", "load_friction.force", "force"),
}
"""Printed name → every spelling of it."""
VALUE = {"valve_area": 2e-6, "end_factor": 1.4, "mass": 9.0, "effects.load_friction.force": 20.0}
PAIRS = [(name, spelling) for name, own in SPELLINGS.items() for spelling in own]
OF_CARD = [pair for pair in PAIRS if pair[0] in CARD.quantities]
WRONG = {
    "valve.aera": "did you mean 'valve_area",
    "Valve_Area": "did you mean 'valve_area",
    "load_friction.forc": "did you mean 'effects.load_friction.force'",
    "coefficient": "may be|did you mean|expected one of",
    "xyz": "expected one of valve_area",
}
"""A name of nothing → what is said."""


@functools.cache
def recording():
    part = jm.read(jm.sample("lift")).part(0, 300)
    return jm.recording(MACHINE, part.columns, part.step, noise=part.card.noise)


def asked(**given):
    given = {"free": FREE, "shared": (), "per_recording": (), "priors": None, "bounds": None, **given}
    return layout(MACHINE, [recording()] * 2, ["a", "b"], asked_for(**given))


def of(unknowns, name) -> Any:
    """The entry of a fit that goes by a printed name."""
    return next(entry for entry in unknowns.entries if entry.name == name)


def scenario_bench():
    return bench_of(MACHINE, {}, jm.commands.Sine(), None, {})


VERBS = {
    "get": lambda name, given, value: get(MACHINE, given) == get(MACHINE, path_of(MACHINE, name, "get")),
    "replace": lambda name, given, value: get(replace(MACHINE, {given: value}), name) == value,
    "free": lambda name, given, value: asked(free=[given]).names == (name,),
    "shared": lambda name, given, value: name in asked(free=None, shared=[given]).names,
    "per_recording": lambda name, given, value: f"{name}[b]" in asked(per_recording=[given]).names,
    "priors": lambda name, given, value: of(asked(priors={given: (value, 1.0)}), name).prior.mean == value,
    "a prior of one recording": lambda name, given, value: (
        of(asked(per_recording=[name], priors={f"{given}[b]": (value, 1.0)}), f"{name}[b]").prior.mean
        == value
    ),
    "bounds": lambda name, given, value: (
        of(asked(bounds={given: (0.0, 1e3 * value)}), name).upper == 1e3 * value
    ),
    "profiles": lambda name, given, value: (
        profiled(
            MACHINE, [recording()], asked_for(None, (), (), None, None, [given]), known_names(MACHINE).keys()
        )
        == [name]
    ),
    "starts": lambda name, given, value: (
        asked().values(begun_at(asked(), [{given: value}], 0)[0])[asked().names.index(name)]
        == pytest.approx(value)
    ),
    "sweep": lambda name, given, value: (
        points_of(scenario_bench(), {given: [value]}).leaves[given].name == name
    ),
    "sweep --over": lambda name, given, value: (
        axis(f"{given}=1,2", CARD, scenario_bench()).unit.name
        == axis(f"{name}=1,2", CARD, scenario_bench()).unit.name
    ),
    "sweep --set": lambda name, given, value: (
        float(get(commanded(CARD, MACHINE, "sine", [f"{given}=3"]).actuator, name))
        == float(get(commanded(CARD, MACHINE, "sine", [f"{name}=3"]).actuator, name))
        != float(get(MACHINE, name))
    ),
    "tune --payload": lambda name, given, value: (
        _payloads([f"{given}=1"], CARD, MACHINE)[given][0].name == name
    ),
    "changes of a scenario": lambda name, given, value: (
        _changes(MACHINE, Scenario(np.zeros(2), np.arange(2.0), {given: value}), "s")
        == {path_of(MACHINE, name, "get"): value}
    ),
}
"""Argument → whether it takes one spelling of a parameter as its printed name."""


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(("name", "given"), PAIRS)
def test_every_spelling_is_right_everywhere(verb, name, given):
    assert VERBS[verb](name, given, VALUE[name])


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_name_is_told_with_the_right_one(verb, wrong):
    with pytest.raises(jm.InputError, match=WRONG[wrong]) as told:
        VERBS[verb]("valve_area", wrong, 1e-6)
    assert f"'{wrong}" in str(told.value)


@pytest.mark.parametrize(("name", "given"), OF_CARD)
def test_a_card_is_updated_and_made_uncertain_by_every_spelling(name, given):
    assert CARD.updated({given: (VALUE[name], 0.1)}).uncertain[name].value == VALUE[name]
    assert set(jm.recording(MACHINE, recording().columns, 2e-3, uncertain={given: 0.1}).card.uncertain) == {
        name
    }


@pytest.mark.parametrize("quoted", [False, True], ids=["dotted", "quoted"])
@pytest.mark.parametrize(("name", "given"), [pair for pair in OF_CARD if pair[0] != pair[1]])
def test_a_card_says_which_name_to_write(name, given, quoted):
    key = f'"{given}"' if quoted else given
    line = next(line for line in TEXT.splitlines() if line.startswith(f"{name} "))
    with pytest.raises(jm.InputError) as told:
        Card.from_toml(TEXT.replace(line, line.replace(name, key, 1)))
    # That the quantity is missing is no second fault.
    assert str(told.value).endswith(f"'{given}' is '{name}' on a card; write {name} = …")


@pytest.mark.parametrize("given", ["load_friction.force", "effects.load_friction.force", "creep.stiffness"])
def test_a_card_says_where_parameters_of_effects_stand(given):
    effect, parameter = given.removeprefix("effects.").split(".")
    text = TEXT.replace("[known]", f"[known]\n{given} = {{ value = 3, unit = 'N' }}")
    with pytest.raises(jm.InputError, match=rf"write {parameter} = … in \[effects.{effect}\]"):
        Card.from_toml(text)


def test_effects_stand_in_no_card_of_a_recording_from_arrays():
    with pytest.raises(jm.InputError, match=r"parameter of an effect.*free=\['load_friction.force'\]"):
        jm.recording(MACHINE, recording().columns, 2e-3, uncertain={"load_friction.force": 1.0})


def test_one_parameter_is_given_once():
    both = {"valve_area": 1e-6, "valve.area": 2e-6}
    with pytest.raises(jm.InputError, match="given twice"):
        replace(MACHINE, both)
    with pytest.raises(jm.InputError, match="given twice"):
        jm.recording(MACHINE, recording().columns, 2e-3, uncertain=both)
    with pytest.raises(jm.InputError, match="given twice"):
        CARD.updated({name: (value, None) for name, value in both.items()})
    with pytest.raises(jm.InputError, match="same parameter"):
        points_of(scenario_bench(), {name: [value] for name, value in both.items()})


def test_the_end_of_several_paths_is_not_guessed():
    scara = bench.model("scara")
    with pytest.raises(UnknownNameError, match="'mass' may be 'first_mass' or 'second_mass'; write which"):
        get(scara, "mass")
    assert get(scara, "second.mass") == get(scara, "second_mass") == get(scara, "arm.second.mass")
    # The end of what is beside the machine is no name of it.
    with pytest.raises(UnknownNameError, match="did you mean 'offset.position'"):
        asked(free=["position"])


@pytest.mark.parametrize("rig", RIGS)
def test_no_two_parameters_of_a_rig_share_a_spelling(rig):
    machine = bench.model(rig, [effect.name for effect in bench.offered(rig)])
    known = known_names(machine)
    for path in parameters(machine):
        name = card_name(machine.quantities, path)
        for given in (path, name, path.removeprefix("effects.")):
            assert known[given].path == path == path_of(machine, given, "get")
            assert get(machine, given) == get(machine, path)


def test_entries_of_arrays_go_by_the_end_of_their_path():
    model = jm.hysteresis.PrandtlIshlinskii(jnp.asarray(2.0), jnp.arange(3.0), jnp.array([1.0, 2.0, 3.0]))
    assert resolve(known_names(model), "weights[1]", "free").value == 1.0
    assert float(get(replace(model, {"weights[2]": 7.0}), "weights[2]")) == 7.0
    with pytest.raises(UnknownNameError, match=r"replace: no parameter 'weights\[3\]'"):
        replace(model, {"weights[3]": 7.0})


def test_values_are_numbers_in_si():
    with pytest.raises(jm.InputError, match=r"expected a number in SI \[m\^2\]; got '1.2 mm\^2'"):
        replace(MACHINE, {"valve_area": "1.2 mm^2"})
    with pytest.raises(jm.InputError, match=r"valve_area: expected numbers in m\^2"):
        points_of(scenario_bench(), {"valve_area": ["1.2 mm^2"]})
    with pytest.raises(jm.InputError, match=r"expected a number in SI \[m\^2\]; got '1.2 mm\^2'"):
        _changes(MACHINE, Scenario(np.zeros(2), np.arange(2.0), {"valve_area": "1.2 mm^2"}), "s")  # pyright: ignore


def test_gains_go_by_the_end_of_their_path():
    pid = jm.control.PID(*map(jnp.asarray, (2.0, 1.0, 0.1)))
    assert gains_of(pid, ["proportional"], {"proportional": (0.0, 9.0)}).unknowns.names == ("proportional",)
    inner = jm.control.FeedForward(pid, pid)
    with pytest.raises(UnknownNameError, match="'proportional' may be 'inverse.proportional' or 'feedback"):
        gains_of(inner, ["proportional"], None)
    both = jm.control.FeedForward(jm.control.FeedForward(pid), None)
    own = gains_of(both, ["proportional"], {"inverse.proportional": (0.0, 9.0)}).unknowns
    assert own.names == ("inverse.inverse.proportional",) and own.entries[0].upper == 9.0
    with pytest.raises(UnknownNameError, match="free: unknown gain 'proportionl'; did you mean"):
        gains_of(both, ["proportionl"], None)
    assert float(get(replace(both, {"proportional": 3.0}), "inverse.inverse.proportional")) == 3.0


def test_a_draft_is_set_by_every_spelling():
    table, _ = table_in_file(jm.sample("lift"))
    for given in ("initial_length", "muscle.initial_length"):
        draft = draft_card(table, RIGS["isotonic"], [f"{given}=310:mm"])
        assert draft.entries["initial_length"] == {"value": 310.0, "unit": "mm"}
    with pytest.raises(jm.InputError, match="has no 'muscle.initial_lenth'; did you mean 'initial_length'"):
        draft_card(table, RIGS["isotonic"], ["muscle.initial_lenth=310:mm"])


@pytest.fixture(scope="module")
def fit():
    free = ["valve_area", "load_friction.force"]
    return jm.fit(MACHINE, [recording()] * 2, free, per_recording=["end_factor"], starts=1, steps=1)


def test_a_fit_is_read_by_every_spelling(fit):
    names = ["valve_area", "effects.load_friction.force", "end_factor[recording]", "end_factor[recording-2]"]
    assert sorted(fit.values) == sorted(fit.table().index) == sorted(names)
    for name, given in [pair for pair in PAIRS if pair[0] in names]:
        assert fit.values[given] == fit.values[name] and fit.std[given] == fit.std[name]
        assert fit.parameters[given] is fit.parameters[name] and given in fit.values
        assert fit.values.get(given) == fit.values[name]
    assert fit.values["muscle.end_factor[recording-2]"] == fit.values["end_factor[recording-2]"]
    with pytest.raises(KeyError, match="unknown parameter 'valve.aera'; did you mean 'valve_area'"):
        fit.values["valve.aera"]
    assert fit.values.get("mass") is None and "mass" not in fit.parameters


def test_a_saved_fit_is_read_so_too(fit, tmp_path):
    again = jm.FitResult.load(fit.save(tmp_path / "fit.json"))
    assert again.parameters["valve.area"] == fit.parameters["valve_area"]
    assert dataclasses.replace(fit, cost=1.0).values["area"] == fit.values["valve_area"]


def test_a_diagnosis_is_read_by_every_spelling():
    found = diagnosis("effects found")
    names = list(found.parameters)
    assert "effects.load_friction.force" in names and "valve_area" in names
    assert found.parameters["valve.area"] is found.parameters["valve_area"]
    assert found.parameters["load_friction.force"] is found.parameters["effects.load_friction.force"]
    own = found.effects[0].parameters
    assert own["force"] is own["load_friction.force"] is own["effects.load_friction.force"]
    with pytest.raises(KeyError, match="did you mean 'valve_area"):
        found.parameters["valve.aera"]


def test_results_by_name_are_ordinary_mappings():
    values = ByName({"valve_area": 1.0, "mass": 2.0}, spelled({"valve_area": "valve.area", "mass": "mass"}))
    assert values == {"valve_area": 1.0, "mass": 2.0} and list(values) == ["valve_area", "mass"]
    assert pickle.loads(pickle.dumps(values))["valve.area"] == 1.0
    del values["valve_area"]
    values["other"] = 3.0
    assert "valve.area" not in values and values["other"] == 3.0 and 0 not in values
    with pytest.raises(KeyError, match="'valve.area'"):
        values["valve.area"]


def test_describe_prints_names_and_readable_values():
    table = describe(MACHINE)
    assert list(table.columns) == ["value", "SI unit", "path", "meaning"] and table.index.name == "name"
    assert list(table.index) == [known_names(MACHINE)[path].name for path in parameters(MACHINE)]
    assert list(table.loc["valve_area"])[:3] == ["1.16709 mm²", "m^2", "valve.area"]
    shown: dict[str, str] = table["value"].to_dict()
    assert shown["braid_angle"] == "22°" and shown["initial_length"] == "300 mm" and shown["mass"] == "8 kg"
    assert shown["valve_time_constant"] == "7.27888 ms" and shown["supply_pressure"] == "8.01325 bar"
    assert shown["effects.load_friction.force"] == "14 N" and shown["polytropic_exponent"] == "1"
    assert describe(replace(MACHINE, {"valve_area": 1e-6})).loc["valve_area", "value"] == "1 mm²"
    assert "0.000001" not in table.to_string() and "e-06" not in table.to_string()


@pytest.mark.parametrize("rig", RIGS)
def test_describe_has_no_powers_of_ten_where_a_unit_would_do(rig):
    table = describe(bench.model(rig, [effect.name for effect in bench.offered(rig)]))
    odd = {name for name, value in table["value"].items() if "·10" in value}
    assert odd <= {"cubic"}  # rad/Pa³


def test_a_controller_without_a_rig_has_no_units_in_its_values():
    shown = describe(jm.control.PID(*map(jnp.asarray, (2.0, 1.5, 0.0))))["value"]
    assert list(shown.loc[["proportional", "integral", "derivative"]]) == ["2", "1.5", "0"]
