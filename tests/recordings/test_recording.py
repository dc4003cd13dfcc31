"""Several runs as one recording, and a part of one."""

import dataclasses

import numpy as np
import pytest
from oracles import bench
from oracles.recorded import clock, driven_card, driven_recording

import jaxmuscle as jm
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.errors import InputError
from jaxmuscle.recordings import actuator_from_card, read
from jaxmuscle.recordings.joining import joined
from jaxmuscle.recordings.recording import Recording
from jaxmuscle.samples import sample
from jaxmuscle.simulation.simulate import simulate


@pytest.fixture(scope="module")
def whole():
    return driven_recording({}, driven_card({}), seconds=6.0)


def test_columns_follow_each_other(whole):
    runs = [whole.part(100, 250), whole.part(0, 80), whole.part(400, None)]
    together = joined(runs, "three")
    assert (together.name, together.breaks, len(together)) == ("three", (150, 230), 430)
    for name, values in together.columns.items():
        np.testing.assert_array_equal(values, np.concatenate([run.columns[name] for run in runs]))
    np.testing.assert_allclose(together.time, 1.0 + 0.01 * np.arange(430), rtol=1e-12)


def test_breaks_of_what_is_joined_are_kept(whole):
    pair = joined([whole.part(0, 100), whole.part(0, 200)], "pair")
    assert joined([whole.part(0, 50), pair, pair], "all").breaks == (50, 150, 350, 450)


def test_part_keeps_the_breaks_inside(whole):
    recording = dataclasses.replace(whole, breaks=(100, 200, 300))
    assert recording.part(100, 300).breaks == (100,)
    assert recording.part(50, None).breaks == (50, 150, 250)
    assert recording.part(-390, -310).breaks == ()
    assert recording.part(-450, -350).breaks == (50,)


def test_one_recording_stays_what_it_is(whole):
    alone = joined([whole], "alone")
    assert alone.breaks == ()
    np.testing.assert_allclose(alone.time, whole.time, atol=1e-12)


def test_nothing_to_join():
    with pytest.raises(ValueError, match="at least one recording"):
        joined([], "none")


def test_sampling_steps_that_differ(whole):
    with pytest.raises(ValueError, match="one sampling step"):
        joined([whole, dataclasses.replace(whole, step=0.0102)], "two")
    assert len(joined([whole, dataclasses.replace(whole, step=0.01005)], "two")) == 1200


def held(command: np.ndarray) -> Recording:
    """The valve's command, begun with the empty muscle on its plate; only its first sensors matter."""
    card = read(sample("lift")).card
    columns = {
        "command": command,
        "pressure": np.full(len(command), bench.AMBIENT),
        "position": np.zeros(len(command)),
    }
    return Recording("held", None, None, card, clock(len(command), 0.002), 0.002, columns)


def delayed(recording: Recording) -> AbstractActuator:
    """The card's machine with a delay and a hysteresis: both remember what was before."""
    machine = bench.model("isotonic", command_delay={"delay": 0.012}, length_hysteresis=bench.LOOP)
    return actuator_from_card(recording.card).with_effects(**machine.effects)


@pytest.mark.slow
def test_a_new_run_starts_at_rest():
    """Neither opening nor pressure, position, hysteresis or delayed command is carried over a break."""
    first = held(np.where(np.arange(200) < 150, 4.0, 2.0))
    second = held(np.where(np.arange(160) < 100, 3.0, -5.0))
    actuator = delayed(first)
    together = simulate(actuator, joined([first, second], "both")).readings
    alone = [simulate(actuator, run).readings for run in (first, second)]
    for name, values in together.items():
        expected = np.concatenate([np.asarray(run[name]) for run in alone])
        np.testing.assert_allclose(values, expected, rtol=1e-10, atol=1e-12)
        assert np.ptp(expected[200:]) > 0.1 * np.ptp(expected[:200])


def _own(**how):
    machine = actuator_from_card(driven_card({}))
    made = driven_recording({}, driven_card({}), seconds=3.0)
    return jm.recording(machine, made.columns, made.step, **how)


def test_what_is_uncertain_stands_on_the_card_from_the_machines_value_on():
    card = _own(uncertain={"end_factor": 0.05}).card
    assert list(card.uncertain) == ["end_factor"] and "end_factor" not in card.known
    assert card.uncertain["end_factor"].std == 0.05
    assert card.uncertain["end_factor"].value == driven_card({}).quantities["end_factor"].value
    assert _own().card.uncertain == {}


@pytest.mark.parametrize(
    ("uncertain", "said"),
    [({"end_facto": 0.1}, "did you mean 'end_factor'"), ({"end_factor": 0.0}, "above zero")],
)
def test_what_cannot_be_uncertain_is_told(uncertain, said):
    with pytest.raises(InputError, match=said):
        _own(uncertain=uncertain)


def test_a_terminal_shows_columns_and_what_is_open(whole):
    lines = str(read(sample("lift"))).splitlines()
    assert lines[0] == "lift: rig isotonic, 6000 samples at 500 Hz"
    cells = [line.split() for line in lines[1:5]]
    assert cells[0] == ["from", "to", "noise"]  # No reading is missing, and nothing is said of it.
    assert cells[2] == ["pressure", "1.216", "bar", "6.590", "bar", "400", "Pa"]
    assert lines[6].startswith("to be fitted: valve area 1.2 ± 0.2 mm²,")
    assert lines[7] == "effects that the card declares: thread friction"
    gappy = dataclasses.replace(whole, columns={**whole.columns, "force": np.full(len(whole), np.nan)})
    row = next(line for line in str(gappy).splitlines() if line.startswith("force"))
    assert row.split()[-1] == str(len(whole))
