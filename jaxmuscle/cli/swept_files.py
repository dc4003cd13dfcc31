"""Sweep from the command line: options in the units of the card, a dataset and a picture in files."""

from __future__ import annotations

import contextlib
import dataclasses
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import xarray as xr

from jaxmuscle.actuators import RIGS
from jaxmuscle.actuators.actuator import AbstractActuator
from jaxmuscle.cli.option_values import Unit, numbers_of, split_option
from jaxmuscle.errors import InputError, nearest
from jaxmuscle.files import atomic_write, check_place
from jaxmuscle.parameter_names import COMMAND
from jaxmuscle.parameters import Parameter, get, replace
from jaxmuscle.progress import interruptible
from jaxmuscle.recordings.card import Card, actuator_from_card
from jaxmuscle.report.sweep_figure import Written, draw_sweep
from jaxmuscle.sweeps import FailedPoints, sweep
from jaxmuscle.sweeps.commands import COMMANDS
from jaxmuscle.sweeps.operating_points import checked_values, swept
from jaxmuscle.sweeps.scenario import Bench, bench_of

LOGARITHMIC = "log"
OVER = "NAME=FROM:TO:N[:log][:UNIT] or NAME=VALUE,VALUE,…[:UNIT]"
SET = "NAME=VALUE[:UNIT]"


@dataclasses.dataclass(frozen=True)
class Axis:
    """One ``--over``: name, values in SI, and the unit in which they were written."""

    name: str
    values: np.ndarray
    unit: Unit


def commanded(card: Card, actuator: AbstractActuator, command: str, settings: Sequence[str]) -> Bench:
    """The machine of a card under a named command, with the values of ``--set``.

    Raises:
        InputError: an unknown command, an unknown name or unit, a value that is no number.
    """
    if command not in COMMANDS:
        raise InputError(f"--command: unknown {command!r}{nearest(command, COMMANDS)}")
    bench = bench_of(actuator, {}, COMMANDS[command](), None, {})
    for text in settings:
        name, body = split_option(text, "--set", SET)
        leaf = swept(bench, name)
        numbers, rest = numbers_of(body.split(":")[0], text, SET), body.split(":")[1:]
        values = _unit(rest, card, name, leaf, text, SET).to_si(numbers)
        # A command may differ from muscle to muscle.
        each = name.startswith(COMMAND) and len(values) == len(actuator.commands)
        shape = np.shape(get(bench, leaf.path)) if len(values) == 1 and not each else values.shape
        if len(values) > 1 and not each:
            raise InputError(f"--set {text}: expected {SET}, one value; got {len(values)}")
        if len(values) == 1:
            checked_values(leaf, name, np.broadcast_to(values, (1, *leaf.shape)))
            shape = leaf.shape
        bench = replace(bench, {leaf.path: jnp.broadcast_to(values if shape else values[0], shape)})
    return bench


def axis(text: str, card: Card, bench: Bench) -> Axis:
    """The values of one ``--over``.

    Raises:
        InputError: another form, an unknown name or unit, a logarithmic axis that is not above zero.
    """
    name, body = split_option(text, "--over", OVER)
    leaf = swept(bench, name)
    parts = body.split(":")
    if "," in parts[0] or len(parts) < 3:
        numbers, rest = numbers_of(parts[0], text, OVER), parts[1:]
    else:
        numbers, rest = _range(parts, text)
    unit = _unit(rest, card, name, leaf, text, OVER)
    return Axis(name, unit.to_si(numbers), unit)


def _range(parts: Sequence[str], text: str) -> tuple[np.ndarray, Sequence[str]]:
    first, last = numbers_of(f"{parts[0]},{parts[1]}", text, OVER)
    if not parts[2].isdigit() or int(parts[2]) < 1:
        raise InputError(f"--over {text}: expected {OVER}; the number of values is {parts[2]!r}")
    count = int(parts[2])
    if parts[3:4] != [LOGARITHMIC]:
        return np.linspace(first, last, count), parts[3:]
    if min(first, last) <= 0:
        raise InputError(f"--over {text}: a logarithmic axis has to be above zero")
    return np.geomspace(first, last, count), parts[4:]


def _unit(rest: Sequence[str], card: Card, name: str, leaf: Parameter, text: str, form: str) -> Unit:
    """The unit that is given; else the one in which the card writes the same quantity; else SI."""
    if len(rest) > 1:
        raise InputError(f"{text}: expected {form}; do not know what {':'.join(rest[1:])!r} is")
    written, gauge = _in_card(card, leaf)
    try:
        unit = Unit(rest[0] if rest else written, leaf.unit, card.ambient_pressure if gauge else 0.0)
        unit.to_si(np.zeros(1))
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    return unit


def _in_card(card: Card, leaf: Parameter) -> tuple[str, bool]:
    """Unit of a leaf in the card and whether it is a gauge pressure there; SI for what it does not hold."""
    rig = RIGS[card.rig]
    owner, _, path = leaf.path.partition(".")
    if owner == "command" and leaf.unit == rig.units.get("command"):
        column = card.columns[rig.commands[0]]
        return column.unit, column.reference == "gauge" and not path.endswith("amplitude")
    entry = card.entries.get(leaf.name)
    return (leaf.unit, False) if entry is None else (entry.unit, entry.reference == "gauge")


SUFFIXES = (".nc", ".zarr")
GIB = 2**30


def swept_files(
    card: Path,
    over: Sequence[str],
    command: str,
    settings: Sequence[str],
    reductions: Sequence[str] | None,
    outputs: Sequence[str] | None,
    duration: float,
    step: float | None,
    out: Path,
    picture: bool,
    memory: float,
    scheduler: str | None,
) -> tuple[list[Path], str]:
    """Run the sweep and write its files; returns these and a note on points that failed, if any did.

    Raises:
        InputError: an ending other than .nc or .zarr, or what :func:`jaxmuscle.sweep` refuses.
    """
    _check_place(out)
    declared = Card.read(card)
    bench: Any = commanded(declared, actuator_from_card(declared), command, settings)
    axes = [axis(text, declared, bench) for text in over]
    given = {one.name: one.values for one in axes}
    if len(given) < len(axes):
        raise InputError("--over: expected each name once")
    with _client(scheduler) as client, warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FailedPoints)
        asked: Any = {
            "command": bench.command,
            "times": _times(duration, step or bench.actuator.largest_step),
            "outputs": outputs,
            "reductions": reductions,
            "memory": memory * GIB,
            "progress": True,
            "store": out if out.suffix == ".zarr" else None,
            "client": client,
        }
        found = interruptible(lambda: sweep(bench.actuator, given, **asked), stop=lambda: None)
        pictures = [out.with_suffix(".png")] if picture else []
        written = {one.name: (one.unit.label, one.unit.from_si) for one in axes}
        _write(found, out, pictures, written)
    return [out, *pictures], "; ".join(str(w.message) for w in caught if issubclass(w.category, FailedPoints))


def _write(found: xr.Dataset, out: Path, pictures: Sequence[Path], written: Written) -> None:
    """Write the dataset, unless it is in its store already, and the picture: both or none."""
    files = [out] if out.suffix == ".nc" else []
    with atomic_write(*files, *pictures) as unfinished:
        for file in unfinished:
            if file.suffix == ".nc":
                found.to_netcdf(file)
            else:
                draw_sweep(found, written, file)


def _times(duration: float, step: float) -> np.ndarray:
    if not 0 < step < duration:
        raise InputError(f"expected 0 < step < duration; got step {step:g} s, duration {duration:g} s")
    return np.arange(round(duration / step) + 1) * step


def _check_place(out: Path) -> None:
    """Better now than after an hour of work."""
    if out.suffix not in SUFFIXES:
        raise InputError(f"--out {out}: expected a name that ends in {' or '.join(SUFFIXES)}")
    if not (out.suffix == ".zarr" and out.is_dir()):  # One that is there is taken up again.
        check_place(out, "--out")


@contextlib.contextmanager
def _client(address: str | None) -> Iterator[Any]:
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("--scheduler: needs dask; pip install 'jaxmuscle[distributed]'") from error
    with Client(address) as client:
        yield client
