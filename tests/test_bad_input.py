"""Whatever is written in cards, tables, arguments and options, only `InputError` comes of it, soon, and files
stay whole. `JAXMUSCLE_CASES=50 python -m pytest -m slow tests/test_bad_input.py` tries fifty times as many
cases, other ones at every run; up to 1, the same ones.
"""

import errno
import os
import signal
import tempfile
from contextlib import contextmanager, suppress
from datetime import timedelta
from pathlib import Path

import input_strategies as given_by
import pytest
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st

import jaxmuscle as jm
from jaxmuscle import InputError
from jaxmuscle.cli.option_values import Unit, numbers_of, split_option, values_of
from jaxmuscle.cli.simulated_files import start_of
from jaxmuscle.cli.swept_files import axis, commanded
from jaxmuscle.control import PID
from jaxmuscle.effects.names import effect_named
from jaxmuscle.estimation.request import by_name, factors, names, read_bounds, read_prior, seconds, whole
from jaxmuscle.files import atomic_folder, atomic_write
from jaxmuscle.parameter_names import resolve
from jaxmuscle.parameters import known_names
from jaxmuscle.recordings import Card, actuator_from_card
from jaxmuscle.recordings.column_guess import guess_rig
from jaxmuscle.recordings.draft import draft_card
from jaxmuscle.recordings.readers import read_table
from jaxmuscle.recordings.row_selection import request_of
from jaxmuscle.recordings.spans import fraction, rows_within
from jaxmuscle.recordings.survey import survey
from jaxmuscle.tuning.gains import gains_of
from jaxmuscle.units import check_unit, unit_in

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]

TIMES = float(os.environ.get("JAXMUSCLE_CASES", "1"))
INPUTS = {
    "cards": 1300,
    "card texts": 2700,
    "tables": 1600,
    "surveys": 300,
    "recordings": 600,
    "options": 3000,
    "names": 3500,
    "gains": 1500,
    "arguments": 4600,
    "files": 900,
}
"""Kind of input → how many are made."""
LONGEST = 20.0
"""Seconds after which a case counts as one that hangs, on a busy machine too."""

LIFT = Card.read(jm.sample("lift").with_suffix(".toml"))
MACHINE = actuator_from_card(LIFT)
KNOWN = known_names(MACHINE)
BENCH = commanded(LIFT, MACHINE, "sine", [])
SAMPLE = jm.read(jm.sample("lift"))
OF_OPTIONS = (
    lambda text: axis(text, LIFT, BENCH),
    lambda text: commanded(LIFT, MACHINE, "sine", [text]),
    lambda text: commanded(LIFT, MACHINE, text, []),
    lambda text: start_of([text], LIFT),
    lambda text: numbers_of(text, text, "FORM"),
    lambda text: values_of(text, text, "FORM", Unit("bar", "Pa", 1e5, 1e5)),
    lambda text: split_option(text, "--x", "FORM"),
    lambda text: request_of(text, None),
    lambda text: rows_within(SAMPLE, [text], "--ignore"),
    lambda text: fraction(text),
    lambda text: unit_in(text),
    lambda text: check_unit(text, "Pa"),
)
OF_NAMES = (effect_named, lambda name: resolve(KNOWN, name, "free"))
OF_ARGUMENTS = (
    lambda value: names(value, "free"),
    lambda value: by_name(value, "bounds"),
    lambda value: factors(value, "continuation"),
    lambda value: whole(value, "steps", 1),
    lambda value: seconds(value, "budget"),
    lambda value: read_prior(value, "priors['x']"),
    lambda value: read_bounds(value, "bounds['x']"),
    lambda value: request_of(value, None),
    lambda value: request_of(None, value),
)
"""Readers of what users write, each with one argument."""


def cases(kind):
    """So many cases of a kind, the same at every run unless more are asked for."""
    return settings(
        max_examples=max(int(INPUTS[kind] * TIMES), 1),
        deadline=timedelta(seconds=LONGEST),
        derandomize=TIMES <= 1,
        database=None,
        phases=(Phase.explicit, Phase.generate, Phase.shrink),
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.filter_too_much],
    )


@contextmanager
def soon():
    """Fail where the block hangs."""

    def hangs(*_):
        raise TimeoutError(f"not at its end after {LONGEST:g} s")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def told():
    """Only a message for the user comes of it, with something in it."""
    with soon():
        try:
            yield
        except InputError as error:
            assert str(error).strip()


def test_there_are_enough_cases():
    """A case is one input, however many readers are given it."""
    assert sum(INPUTS.values()) >= 20_000


@cases("cards")
@given(given_by.card_mappings())
def test_cards(mapping):
    with told():
        card = Card.parse(mapping)
        actuator_from_card(card)
        assert Card.from_toml(card.to_toml()) == card


@cases("card texts")
@example("x = " + "9" * 5000)
@example("x = " + "[" * 5000)
@given(given_by.card_texts())
def test_card_texts(text):
    with tempfile.TemporaryDirectory() as folder, told():
        file = Path(folder, "card.toml")
        file.write_text(text, encoding="utf-8", errors="surrogatepass", newline="")
        card = Card.read(file)
        assert Card.from_toml(card.to_toml()) == card


@cases("tables")
@given(given_by.table_files())
def test_tables(file):
    name, content = file
    with told():
        table = read_table(Path(name), content)
        for column in table.columns:
            with suppress(InputError):
                table.numbers(column)
        guess_rig(table, jm.actuators.RIGS)
        draft_card(table, type(MACHINE)).to_toml("x.csv")


@cases("surveys")
@given(given_by.table_files(), given_by.card_mappings() | st.just(given_by.PARSED["lift"]))
def test_surveys_of_cards_and_tables(file, mapping):
    text = given_by.toml_of(mapping)
    with tempfile.TemporaryDirectory() as folder, told():
        table, card = Path(folder, file[0]), Path(folder, "card.toml")
        table.write_bytes(file[1])
        card.write_text(text or "", encoding="utf-8", errors="replace")
        survey(card, table, resample=True)
        jm.read(table, card)


@cases("recordings")
@given(given_by.recordings())
def test_arrays(arguments):
    with told():
        jm.recording(MACHINE, arguments.pop("columns"), arguments.pop("step"), **arguments)


@cases("options")
@given(given_by.options())
def test_options(text):
    for read in OF_OPTIONS:
        with told():
            read(text)


@cases("names")
@given(given_by.texts() | given_by.options())
def test_names_of_parameters_and_effects(name):
    for read in OF_NAMES:
        with told():
            read(name)


@cases("gains")
@given(given_by.gains())
def test_gains(arguments):
    with told():
        controller = PID(**{"proportional": 1.0, **arguments["controller"]})
        gains_of(controller, arguments["free"], arguments["bounds"])


@cases("arguments")
@given(given_by.anything())
def test_arguments_of_fits_and_tunings(value):
    for read in OF_ARGUMENTS:
        with told():
            read(value)


FAULTS = (OSError(errno.ENOSPC, "No space left"), RuntimeError("x"), KeyboardInterrupt(), None)


@cases("files")
@given(
    st.lists(st.sampled_from(["a.txt", "b.txt", "c.txt"]), min_size=1, max_size=3, unique=True),
    st.sampled_from(FAULTS),
    st.integers(0, 3),
    st.booleans(),
    st.booleans(),
)
def test_files_are_whole(written, fault, moment, there, in_folder):
    with tempfile.TemporaryDirectory() as folder, soon():
        place = Path(folder, "new") if in_folder else Path(folder)
        old = dict.fromkeys(written, "old") if there else {}
        if there:
            place.mkdir(exist_ok=True)
        for name in old:
            (place / name).write_text("old")
        new = (
            atomic_folder(place, written) if in_folder else atomic_write(*(place / name for name in written))
        )
        failed = False
        try:
            with new as files:
                for number, file in enumerate(files):
                    file.write_text("new")
                    if number == moment and fault is not None:
                        raise fault
        except (InputError, RuntimeError, KeyboardInterrupt):
            failed = True
        assert failed == (fault is not None and moment < len(written))
        found = {p.name: p.read_text() for p in place.iterdir()} if place.is_dir() else {}
        assert found == (old if failed else dict.fromkeys(written, "new"))
        assert {p.name for p in Path(folder).iterdir()} <= {"new", *written}
