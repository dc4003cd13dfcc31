"""Fixed-length recordings of Festo 10 mm muscles (Portland State University) for the rig `sized-muscles`.

The raw files have their quirks (see SOURCE.txt beside them): the columns of the 257 mm muscle are swapped
and scaled by each other's calibration, the load cell saturates when the muscle is slack, the pressure
sensor reads 8.2 kPa at ambient. Here the samples (530 Hz, not quite uniform) are averaged over 0.1 s.
"""

from __future__ import annotations

import dataclasses
import os
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.signal import medfilt
from sized_muscles import SizedMuscles

from jaxmuscle.recordings import Card, Recording
from jaxmuscle.recordings.joining import joined

Series = NDArray[np.float64]

CARD = Path(__file__).parent / "cards" / "psu_10mm.toml"
RESTING = {"10": 0.083, "15": 0.132, "25": 0.233, "27": 0.257, "30": 0.281}
"""Cut length in cm, the name of the files → resting length [m]."""
LENGTHS = {
    "10": (0.083, 0.07975, 0.0765, 0.07325),
    "15": (0.132, 0.12675, 0.1215, 0.11625),
    "25": (0.233, 0.223, 0.213, 0.203),
    "27": (0.257, 0.250, 0.242, 0.226),
    "30": (0.281, 0.26875, 0.2565, 0.24425),
}
"""Lengths at which each muscle was held [m], in the order of the conditions."""
LENGTHS_UNKNOWN = {"45": 0.432, "52": 0.502}
"""Further muscles: resting length [m], the cut length less 18 mm as with the others."""
SHORTEST = {"25": 0.193, "27": 0.221}
"""Free lengths at 620 kPa of the two muscles that the makers print errors of [m]."""
CONTRACTION = 0.17
"""Contraction ratio at 620 kPa of the longer muscles; the conditions are 0, 1/4, 1/2 and 3/4 of it."""
CONDITIONS = ("Unkink", "kinked25", "kinked50", "kinked75")
CONDITIONS_257 = ("Unkinked", "Kinked7mm", "Kinked15mm", "Kinked31mm")
TESTS = ("Test8Data", "Test9Data", "Test10Data")
"""Pulses of 10 and 5 ms; those of 50 ms leave no settled force in a period."""
PRESSURE_ZERO = 8.2e3
BIN = 0.1
PERIOD = 0.5
SLACK = 5.0
"""Force below which the muscle counts as slack [N]: the load cell says nothing more."""
AMBIENT = 101325.0


def folder() -> Path | None:
    """Where the data are: the folder named by JAXMUSCLE_DATA, or ../shared/real beside the project."""
    places = [os.environ.get("JAXMUSCLE_DATA"), Path(__file__).parents[2] / "shared" / "real"]
    for place in places:
        if place and (Path(place) / "psu_bpa_isometric").is_dir():
            return Path(place) / "psu_bpa_isometric"
    return None


def makers_force(muscle: str, length: Series, pressure: Series) -> Series:
    """Force by the makers' empirical law [N]; F* = c0 (exp(-c1 ε*) - 1) + P* exp(-c2 ε*²).

    Bolen, Elzein, Pang and Hunt 2026: ε* = ε/ε_620, P* = P/620 kPa, F = F620 F* with
    F620 = 303.5 N atan(19.03 (l0 - 7.5 mm)/m), c = (0.5682, 4.254, 0.5597). A slack muscle has no force.

    Args:
        muscle: a key of :data:`SHORTEST`.
        length, pressure: of the muscle [m]; gauge, as the makers' sensor reads it [Pa].
    """
    rest = RESTING[muscle]
    contraction, share = (rest - length) / (rest - SHORTEST[muscle]), pressure / 620e3
    full = 303.5 * np.arctan(19.03 * (rest - 0.0075))
    relative = 0.5682 * np.expm1(-4.254 * contraction) + share * np.exp(-0.5597 * contraction**2)
    return np.maximum(full * relative, 0.0)


@dataclasses.dataclass(frozen=True)
class Held:
    """Recordings of several lengths or muscles as one, with what each row belongs to.

    `settled`: the 0.1 s before a valve opens, muscle not slack: the static points.
    """

    recording: Recording
    muscle: NDArray[np.str_]
    length: NDArray[np.int64]
    settled: NDArray[np.bool_]
    slack: NDArray[np.bool_]


def held(root: Path, muscles: tuple[str, ...]) -> Held:
    """All lengths of some muscles, each with its own nominal length at rest.

    By how much all are longer only muscles of several lengths tell; of one the nominal length is taken.
    """
    card = Card.read(CARD)
    assert card.rig == SizedMuscles.rig
    if len(muscles) == 1:
        card = card.updated({"excess_length": (0.0, None)})
    parts, muscle, length, phase = [], [], [], []
    for name in muscles:
        for number, samples in _files(root, name):
            time, pressure, force = _binned(samples)
            columns = {
                "pressure": pressure - PRESSURE_ZERO + AMBIENT,
                "position": np.full(len(time), RESTING[name] - LENGTHS[name][number]),
                "resting_length": np.full(len(time), RESTING[name]),
                "force": force,
            }
            parts.append(Recording("psu", None, None, card, time, BIN, columns))
            muscle += [name] * len(time)
            length += [number] * len(time)
            phase.append(np.mod(time, PERIOD))
    whole = joined(parts, "psu_" + "_".join(muscles))
    slack = whole.columns["force"] < SLACK
    in_period = np.concatenate(phase)
    settled = (in_period > 0.29) & (in_period < 0.41) & ~slack
    return Held(whole, np.array(muscle), np.array(length), settled, slack)


def raw(root: Path, muscle: str) -> list[tuple[int, tuple[Series, Series, Series]]]:
    """Every file of a muscle as sampled: number of its length, time [s], gauge pressure [Pa], force [N].

    Samples whose time does not lie after that of the sample before are left out.
    """
    return [(number, _forward(samples)) for number, samples in _files(root, muscle)]


def size(muscle: str, number: int) -> tuple[float, float]:
    """Resting length [m] and contraction ratio; nominal for the muscles whose lengths are not given."""
    if muscle in LENGTHS_UNKNOWN:
        return LENGTHS_UNKNOWN[muscle], CONTRACTION * number / 4
    return RESTING[muscle], 1 - LENGTHS[muscle][number] / RESTING[muscle]


def _files(root: Path, muscle: str) -> list[tuple[int, tuple[Series, Series, Series]]]:
    found = []
    for number in range(1 if muscle == "45" else 4):
        if muscle == "27":
            path = root / "10mm_257mm_Jan2022_raw" / f"10mm_27cm_{CONDITIONS_257[number]}_Test9.csv"
            found.append((number, _swapped(np.loadtxt(path, delimiter=","))))
            continue
        path = root / "10mm_Nov2022" / f"10mm_{muscle}cm_{CONDITIONS[number]}.mat"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # one opaque table object that SciPy cannot read
            content = loadmat(path)
        for test in TESTS:
            if test in content:
                table = content[test]
                found.append((number, (table[:, 2], 1e3 * table[:, 1], table[:, 0])))
    return found


def _swapped(table: NDArray[np.float64]) -> tuple[Series, Series, Series]:
    """The 257 mm muscle: undo the exchanged calibrations."""
    pressure = 0.7654 * ((table[:, 0] / 4.45 + 1.963) / 0.1535) - 18.609
    force = 4.45 * (0.1535 * ((table[:, 1] + 18.609) / 0.7654) - 1.963)
    return table[:, 2], 1e3 * pressure, force


def _forward(samples: tuple[Series, Series, Series]) -> tuple[Series, Series, Series]:
    """Samples in the order of time: single wild times and repeated ones go."""
    time = samples[0]
    near = np.abs(time - medfilt(time, 5)) < PERIOD
    before = np.maximum.accumulate(np.where(near, time, -np.inf))
    kept = near & (time > np.concatenate([[-np.inf], before[:-1]]))
    pressure, force = samples[1][kept], samples[2][kept]
    return time[kept], pressure, force


def _binned(samples: tuple[Series, Series, Series]) -> tuple[Series, Series, Series]:
    """Means over bins of 0.1 s that begin with the valves' periods."""
    time, pressure, force = samples
    number = np.floor(time / BIN + 1e-9).astype(int)
    last = number.max()
    count = np.bincount(number, minlength=last + 1)
    full = np.flatnonzero(count > 0)
    pressure, force = (
        np.bincount(number, values, minlength=last + 1)[full] / count[full] for values in (pressure, force)
    )
    return full * np.float64(BIN), pressure, force
