"""A sweep as the command line asks for it: from a card to a dataset and a picture in files."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from jaxmuscle.errors import InputError
from jaxmuscle.files import atomic_write
from jaxmuscle.interruptible import interruptible
from jaxmuscle.recordings.card import Card, actuator_from_card
from jaxmuscle.report.sweep_figure import draw_sweep
from jaxmuscle.sweeps import FailedPoints, sweep
from jaxmuscle.sweeps.options import axis, commanded

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
        if out.suffix == ".nc":
            with atomic_write(out) as (unfinished,):
                found.to_netcdf(unfinished)
        files = [out]
        if picture:
            files.append(out.with_suffix(".png"))
            draw_sweep(found, {one.name: (one.unit.label, one.unit.from_si) for one in axes}, files[-1])
    return files, "; ".join(str(w.message) for w in caught if issubclass(w.category, FailedPoints))


def _times(duration: float, step: float) -> np.ndarray:
    if not 0 < step < duration:
        raise InputError(f"expected 0 < step < duration; got step {step:g} s, duration {duration:g} s")
    return np.arange(round(duration / step) + 1) * step


def _check_place(out: Path) -> None:
    """Better now than after an hour of work."""
    if out.suffix not in SUFFIXES:
        raise InputError(f"--out {out}: expected a name that ends in {' or '.join(SUFFIXES)}")
    if not out.absolute().parent.is_dir():
        raise InputError(f"--out {out}: there is no folder {str(out.absolute().parent)!r}")


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
