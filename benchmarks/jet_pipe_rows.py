"""The actuator of [H] at its published values, and how a row of a table is written."""

from __future__ import annotations

from typing import Any

import jaxmuscle  # noqa: F401  (double precision)
from jaxmuscle.actuators import JetPipeActuator
from jaxmuscle.components import CurrentDriver, Cylinder, JetPipe, Receiver
from jaxmuscle.parameters import replace

AMBIENT, SUPPLY = 101325.0, 551.6e3
GAIN = 0.1
"""Of the current driver [A/V]; adjustable in [H]."""
STOPPER = 0.054
"""Of Table 4.1 [m]."""
BANDWIDTHS = (0.8, 2.8)
"""Measured in [H] 3.3.2 [Hz]."""
SLOPE = "the pipe's mid-line (Figure 3.5) is not given in numbers: 0.8 mm/N, saturating at 0.9 N, is assumed"
ZERO = (
    "the zero at -5.1 instead of -7.1 cancels less of the slow pole, so that the -3 dB corner is that of "
    "both fluid poles; the dominant pole alone does as published"
)
Row = dict[str, Any]


def actuator(**changed: float) -> JetPipeActuator:
    """The actuator of [H] at 80 psig; compliance and saturation of the pipe are assumed."""
    kind: Any = JetPipeActuator
    driver: Any = CurrentDriver
    pipe: Any = JetPipe
    receiver: Any = Receiver
    made = kind(
        driver(GAIN), pipe(0.8e-3, 0.9, 0.099e-3), receiver(0.696, AMBIENT + SUPPLY), Cylinder(), STOPPER,
        gas_temperature=293.0,
    )  # fmt: skip
    return replace(made, {path.replace("__", "."): value for path, value in changed.items()})


def row(
    source: str, quantity: str, published: str, ours: float | list[float], ok: bool,
    unit: str = "", tolerance: str = "", reason: str = "", why: str = "",
) -> Row:  # fmt: skip
    """One line of the table; what differs keeps its place and says why."""
    entry = {"source": source, "quantity": quantity, "published": published, "ours": ours, "unit": unit,
             "tolerance": tolerance, "reason": reason, "ok": bool(ok)}  # fmt: skip
    return {**entry, "why": why} if why else entry


def near(
    source: str, quantity: str, published: float, ours: float, unit: str, share: float, reason: str,
    why: str = "",
) -> Row:  # fmt: skip
    """A row that asks for a relative deviation of at most `share`."""
    ok = abs(ours - published) <= share * abs(published)
    return row(
        source, quantity, f"{published:g}", ours, ok, unit, f"{share:.3g} relative", reason, "" if ok else why
    )


def shown(value: object) -> str:
    """A number, or several, in four digits."""
    return ", ".join(f"{v:.4g}" for v in value) if isinstance(value, list) else f"{value:.4g}"


def line(entry: Row) -> str:
    """A row as text."""
    ours = f"{shown(entry['ours'])} {entry['unit']}".rstrip()
    mark = "ok" if entry["ok"] else "NO"
    text = f"{mark:3s}{entry['source']}: {entry['quantity']}: {ours}; published {entry['published']}"
    if entry["tolerance"]:
        text += f" (to {entry['tolerance']}: {entry['reason']})"
    return text + (f"\n     {entry['why']}" if "why" in entry else "")
