"""Tuning from the command line: a card and references in; gains, a report and a table of commands out."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.cli.control_tasks import ControlledColumns, controlled_columns
from jaxmuscle.cli.option_values import Unit, split_option, values_of
from jaxmuscle.cli.simulated_files import DIGITS, by_column, check_finite, start_of
from jaxmuscle.cli.starting_controllers import starting_controller
from jaxmuscle.cli.tuning_scenarios import ScenarioMaker, machines
from jaxmuscle.control import closed_loop
from jaxmuscle.control.sliding_mode import target_of
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.parameter_names import resolve
from jaxmuscle.parameters import Parameter, known_names
from jaxmuscle.progress import interruptible
from jaxmuscle.recordings.card import Card, actuator_from_card
from jaxmuscle.recordings.read import table_name
from jaxmuscle.recordings.signal_tables import read_signals, signal_table
from jaxmuscle.recordings.table_checks import is_regular
from jaxmuscle.report.report_files import placed, writable_folder
from jaxmuscle.report.tuning_page import tuning_page
from jaxmuscle.simulation.simulate import simulate
from jaxmuscle.tuning import TERMS, Scenario, Tuning, tune
from jaxmuscle.tuning.cost_terms import units
from jaxmuscle.units import Series, is_same_unit

PAYLOAD = "NAME=VALUE,VALUE,…[:UNIT]"
TERM = "TERM=SIZE[:UNIT]"
SETTLING = 2.0
"""Time for which the machine comes to rest under the command of no output before a scenario begins [s]."""
OTHER_NOISE = 100_000
"""Distance of the seeds of held-out noise from those of the noise that is tuned on."""


@dataclasses.dataclass(frozen=True)
class Request:
    """What the command line asks for, as it was written.

    Attributes:
        references, held_out: tables of references.
        payloads, objective, gains, start: options with names and values.
        sample_time: of the controller [s]; that of the first reference when `None`.
        draws: machines that are drawn from what the card is unsure of, for tuning and as many for the last
            word.
    """

    card: Path
    controller: str
    references: Sequence[Path]
    held_out: Sequence[Path] = ()
    payloads: Sequence[str] = ()
    objective: Sequence[str] = ()
    gains: Sequence[str] = ()
    start: Sequence[str] = ()
    sample_time: float | None = None
    draws: int = 4
    starts: int = 8
    steps: int = 50
    budget: float | None = None
    seed: int = 0


def tuned_files(request: Request, folder: Path, progress: Callable[[str], None]) -> tuple[Tuning, list[Path]]:
    """Tune a controller for a card's machine, and write gains, report and commands.

    Returns:
        the result, and the files: ``gains.toml``, ``report.html``, and ``commands.csv``, the commands of the
        tuned controller along the first reference on the card's own machine, and what its sensors then show,
        as the card describes it.

    Raises:
        InputError: a card, a table or an option that is not what it should be, a rig without a control
            channel, a loop that runs away wherever it is begun; nothing is written.
    """
    writable_folder(folder)
    begins = starting_controller(request.controller)
    card = Card.read(request.card)
    actuator = actuator_from_card(card)
    controlled = controlled_columns(actuator)
    references = {table_name(f): _reference(f, card, controlled.columns) for f in request.references}
    unseen = {table_name(f): _reference(f, card, controlled.columns) for f in request.held_out}
    first = next(iter(references.values()))
    step = _sample_time(request, first)
    payloads = _payloads(request.payloads, card, actuator)
    objective = _objective(request.objective, card, controlled)
    tasks = controlled.tasks(card, [wanted for _, wanted in references.values()], step)
    controller = controlled.together(begins.for_all(tasks, request.gains))
    begin = {**_settled(controlled, step), **start_of(request.start, card)}
    some, others = machines(card, actuator, request.draws, request.seed)
    make = ScenarioMaker(actuator, card, step, begin, payloads, begins.rates)
    training = make.scenarios(references, [{}, *some], request.seed)
    last = others or ([{}] if unseen else [])
    held_out = make.scenarios(unseen or references, last, request.seed + OTHER_NOISE, len(some) + 1)
    asked: Any = {"budget": request.budget, "seed": request.seed, "starts": request.starts}
    tuned = interruptible(
        lambda: tune(
            actuator,
            controller,
            training,
            objective,
            held_out=held_out,
            steps=request.steps,
            progress=progress,
            **asked,
        ),
        stop=lambda: None,
    )
    progress("writing the results")
    origin = "gains as they were given" if request.gains else begins.origin
    texts = {
        "gains.toml": tuned.to_toml(),
        "report.html": tuning_page(tuned, request.card.stem, card.rig, origin),
        "commands.csv": _commands(controlled, card, tuned, training[0]),
    }
    return tuned, placed(texts, folder)


def _reference(file: Path, card: Card, columns: tuple[str, ...]) -> tuple[Series, Series]:
    """A reference, with a column for each joint of a robot; straight lines lead from a row to the next."""
    time, found = read_signals(file, card, columns, regular=False, kind="reference")
    values = np.stack([found[name] for name in columns], axis=-1)
    return time, values if len(columns) > 1 else values[:, 0]


def _sample_time(request: Request, first: tuple[Series, Series]) -> float:
    """The sample time that is given, else the step of the first reference [s].

    Raises:
        InputError: it is none, too long for the reference, or needed as the reference has no one step.
    """
    time, step = first[0], request.sample_time
    if step is None:
        if not is_regular(time):
            raise InputError(
                f"{request.references[0]}: its rows are not equally far apart, which is as good; then say "
                f"how often the controller samples: --sample-time"
            )
        step = float(time[-1] - time[0]) / (len(time) - 1)
    longest = float(time[-1] - time[0]) / 2
    if not 0 < step <= longest:
        raise InputError(
            f"--sample-time: expected a time above zero, at most half the reference, {longest:g} s; "
            f"got {step:g}"
        )
    return step


def _payloads(
    settings: Sequence[str], card: Card, actuator: AbstractActuator
) -> dict[str, tuple[Parameter, Series]]:
    """Name as written → parameter, values (SI)."""
    known, found = known_names(actuator), {}
    for text in settings:
        name, body = split_option(text, "--payload", PAYLOAD)
        place = resolve(known, name, "--payload")
        if np.ndim(place.value):
            raise InputError(f"--payload {text}: {name} is an array; name one entry, {name}[0]")
        if name in found:
            raise InputError(f"--payload {text}: expected each name once")
        entry = card.entries.get(place.name)
        unit = place.unit if entry is None else entry.unit
        shift = card.ambient_pressure if entry is not None and entry.reference == "gauge" else 0.0
        ambient = card.ambient_pressure if entry is not None and entry.reference else 0.0
        values = values_of(body, f"--payload {text}", PAYLOAD, Unit(unit, place.unit, shift, ambient))
        found[name] = (place, values)
    return found


def _objective(settings: Sequence[str], card: Card, controlled: ControlledColumns) -> dict[str, float] | None:
    """Term → its size that costs one (SI); `None` without one."""
    actuator = controlled.actuator
    known, found = units(actuator, controlled.reading), {}
    written = [card.columns[name].unit for name in (controlled.columns[0], *actuator.commands)]
    for text in settings:
        name, body = split_option(text, "--objective", TERM)
        if name not in TERMS:
            raise InputError(f"--objective: unknown term {name!r}{nearest(name, TERMS)}")
        own = next((unit for unit in written if is_same_unit(unit, known[name])), known[name])
        if name == "variation":
            command = next(u for u in written[1:])
            own = f"({command})/s"
        (size, *more) = values_of(body, f"--objective {text}", TERM, Unit(own, known[name]))
        if more or not size > 0:
            raise InputError(f"--objective {text}: expected {TERM}, one size above zero")
        found[name] = float(size)
    return found or None


def _settled(controlled: ControlledColumns, step: float) -> dict[str, Any]:
    """Measured states after the machine has come to rest under the command of no output."""
    actuator, rest = controlled.actuator, np.asarray(controlled.rest)
    clock = np.arange(max(round(SETTLING / step), 2)) * step
    found = simulate(actuator, np.broadcast_to(rest, (len(clock), *rest.shape)), clock)
    check_finite(found)
    return {name: np.asarray(found.final.values[name]) for name in actuator.measured}


def _commands(controlled: ControlledColumns, card: Card, tuned: Tuning, scenario: Scenario) -> str:
    """The run of the card's machine under the tuned controller, without noise, as a table of the card's."""
    actuator, columns = controlled.actuator, controlled.columns
    loop = controlled.attached(tuned.controller)
    run = closed_loop(actuator, loop, scenario.reference, scenario.clock, start=scenario.start)
    given = np.asarray(run.commands).reshape(len(scenario.clock), -1)
    commands = {name: given[:, i] for i, name in enumerate(actuator.commands)}
    signals = {"time": scenario.clock, **commands, **by_column(actuator, run.readings)}
    table = signal_table(card, signals)
    wanted = np.reshape(target_of(scenario.reference), (len(scenario.clock), len(columns)))
    for name, values in zip(columns, wanted.T, strict=True):
        column = card.columns[name].column
        table[f"{column}_wanted"] = signal_table(card, {name: values})[column]
    return table.to_csv(index=False, float_format=DIGITS, lineterminator="\n")
