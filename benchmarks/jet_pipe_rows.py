"""The actuator of [H] at its published values."""

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
SLOPE = (
    "the pipe's mid-line (Figure 3.5) is not given in numbers: 0.8 mm/N, saturating at 0.9 N, is assumed; "
    "one through two of the published numbers gives the others (rows below)"
)
MIDLINE = "the pipe's mid-line, 0.8 mm/N saturating at 0.9 N"
GAUGE = "551.6 kPa gauge; mid-line 0.8 mm/N, saturating at 0.9 N"
"""The reading of [H] that is declared, under which its numbers are counted."""
ABSOLUTE = "551.6 kPa, 80 psig, taken as the absolute supply pressure"
ZERO = (
    "at 551.6 kPa gauge the zero lies at -5.1 instead of -7.1 and cancels less of the slow pole, so that the "
    f"-3 dB corner is that of both fluid poles; under another reading, {ABSOLUTE}, it does as published "
    "(rows below, not counted); the rated force of the full jet speaks against that reading"
)
CORNER = (
    "the -3 dB corner of both fluid poles and the zero does so neither with 551.6 kPa gauge nor absolute, "
    "chamber 2 kept or shrinking (powers below); the pole that the zero leaves does, and that pole is what "
    "[H] 4.2.2 calls the corner frequency"
)


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
