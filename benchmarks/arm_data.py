"""Episodes of the MPI arm, instants from which its joints are predicted, and predictors of them."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterable
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

import jaxmuscle as jm
from jaxmuscle.actuators import AbstractActuator
from jaxmuscle.estimation.case import case
from jaxmuscle.estimation.residuals import hidden_states
from jaxmuscle.recordings.smoothing import noise_level, rate_from_past
from jaxmuscle.simulation import Start, Track, predict
from jaxmuscle.simulation.track import start_at_rest

Array = NDArray[np.float64]

STEP, AHEAD, PAST = 0.01, 10, 4
"""Sampling step [s]; samples ahead; samples that an episode has before the first instant."""
AMBIENT, FULL = 101325.0, 3e5
"""Normalised pressures from 0 to 1 are taken as 0 to 3 bar gauge [Pa]; the muscles' sizes take the rest."""
EVERY = 4
"""Of the instants one in so many is used."""


@dataclasses.dataclass(frozen=True)
class Arm:
    """All joints: angles [rad], pressures [Pa, absolute], first and last row of every episode."""

    angle: Array
    pressure: Array
    first: NDArray[np.int64]
    last: NDArray[np.int64]

    @property
    def split(self) -> int:
        """The first held-out episode."""
        return int(0.8 * len(self.first))

    @property
    def training(self) -> range:
        """Episodes that may be fitted; one in three is enough for a linear model."""
        return range(0, self.split, 3)

    @property
    def validation(self) -> range:
        """Of these, the last quarter: episodes by which a model is chosen that was fitted without them."""
        return range(int(0.75 * self.split), self.split)

    @property
    def held_out(self) -> range:
        """Episodes that no fit sees."""
        return range(self.split, len(self.first))


@dataclasses.dataclass(frozen=True)
class Instants:
    """Moments with what is known then: the last angles (newest first) and what they tell of the velocity,
    pressures from now on; the truth.

    `place`: the row of each moment in a recording of the `episodes`.
    """

    past: Array
    velocity: Array
    pressure: Array
    before: Array
    then: Array
    episodes: Iterable[int]
    place: NDArray[np.int64]

    @property
    def now(self) -> Array:
        """The angle now."""
        return self.past[:, 0]


def load() -> Arm | None:
    """The data in the folder named by JAXMUSCLE_DATA, or in ../shared/real beside the project."""
    for place in (os.environ.get("JAXMUSCLE_DATA"), Path(__file__).parents[2] / "shared" / "real"):
        file = Path(place or "") / "mpi_pam_arm" / "pam_arm_100Hz.npz"
        if place and file.is_file():
            raw = np.load(file)
            ends = np.cumsum(raw["episode_length"].astype(int))
            begins = ends - raw["episode_length"]
            pressure = AMBIENT + FULL * raw["p_int"] / raw["p_scale"]
            # The first two rows and the last one of an episode jump.
            return Arm(raw["q"].astype(float), pressure, begins + 2, ends - 2)
    return None


def recording(
    arm: Arm,
    joint: int,
    episodes: Iterable[int],
    machine: AbstractActuator,
    noise: float = 0.02,
    horizon: float = (AHEAD + 1) * STEP,
    state_from: str = "past",
) -> jm.Recording:
    """Episodes of one joint, one after the other, to be predicted over a `horizon` [s].

    Args:
        noise: standard deviation of the angle [rad].
        state_from: samples that tell the velocity with which a window begins; a prediction knows the past.
    """
    parts = [np.arange(arm.first[e], arm.last[e] + 1) for e in episodes]
    breaks = np.cumsum([len(part) for part in parts])[:-1].tolist()
    rows = np.concatenate(parts)
    columns = {"angle": arm.angle[rows, joint]}
    columns |= {f"pressure_{i + 1}": arm.pressure[rows, 2 * joint + i] for i in (0, 1)}
    return jm.recording(
        machine,
        columns,
        STEP,
        noise={"angle": noise},
        horizon=horizon,
        state_from=state_from,
        breaks=breaks,
        stretch="all",
    )


def instants(arm: Arm, joint: int, episodes: Iterable[int]) -> Instants:
    """Instants of these episodes with enough samples before and after."""
    lengths = [arm.last[e] + 1 - arm.first[e] for e in episodes]
    begins = np.cumsum([0, *lengths[:-1]])
    spans = [np.arange(PAST, length - AHEAD) for length in lengths]
    place = np.concatenate([begin + span for begin, span in zip(begins, spans, strict=True)])[::EVERY]
    rows = np.concatenate([arm.first[e] + span for e, span in zip(episodes, spans, strict=True)])[::EVERY]
    angle = arm.angle[:, joint]
    pressure = arm.pressure[:, [2 * joint, 2 * joint + 1]]
    runs = [angle[arm.first[e] : arm.last[e] + 1] for e in episodes]
    velocity = np.concatenate([rate_from_past(run, STEP, noise_level(run))[0] for run in runs])
    return Instants(
        angle[rows[:, None] - np.arange(PAST)],
        velocity[place],
        pressure[rows[:, None] + np.arange(AHEAD + 1)],
        pressure[rows - 1],
        angle[rows + AHEAD],
        episodes,
        place,
    )


def linear(train: Instants, test: Instants, *, coming: bool) -> float:
    """Error on `test` of least squares from three angles and two pressures, `coming` ones too if wanted."""

    def features(at: Instants) -> Array:
        used = [at.past[:, :3], at.pressure[:, 0], at.before]
        used += [at.pressure[:, i] for i in (1, 4, 7, 10)] if coming else []
        scaled = [(part - AMBIENT) / FULL if part is not used[0] else part for part in used]
        return np.column_stack([np.ones(len(at.then)), *scaled])

    weights = np.linalg.lstsq(features(train), train.then, rcond=None)[0]
    return rms(features(test) @ weights - test.then)


def remembered(machine: AbstractActuator, arm: Arm, joint: int, at: Instants) -> Start:
    """What effects remember at every instant: carried along the measured episodes, each from rest."""
    episodes = case(recording(arm, joint, at.episodes, machine), 0.0, actuator=machine).problem
    hidden = hidden_states(machine, episodes)
    return jax.tree.map(lambda values: values[at.place], hidden)


def ahead(
    machine: AbstractActuator, at: Instants, *, fade: float | None = None, hidden: Start | None = None
) -> Array:
    """The angle that the machine has 100 ms later.

    Args:
        hidden: what effects remember at every instant; as at rest when `None`.
        fade: pressures go on as they last did, ever more slowly with this time constant [s]; 0: they stay as
            they are now; `None`: those that were measured afterwards.
    """
    pressure = at.pressure if fade is None else _continued(at, fade)
    return np.asarray(_ahead(machine, jnp.asarray(pressure), at.now, at.velocity, hidden))


def _continued(at: Instants, fade: float) -> Array:
    """Pressures of the coming 100 ms from those of now and of the sample before."""
    now = at.pressure[:, :1]
    way = STEP * np.arange(AHEAD + 1)
    share = fade / STEP * -np.expm1(-way / fade) if fade else np.zeros(AHEAD + 1)
    return now + (now - at.before[:, None]) * share[:, None]


@eqx.filter_jit
def _ahead(machine, pressure, angle, velocity, hidden):
    """Every instant is a run of its own on one long track."""
    count, length, _ = pressure.shape
    first = lambda values: jnp.repeat(values, length)  # noqa: E731
    measured = {
        "pressure": pressure.reshape(-1, 2),
        "angle": first(angle),
        "angular_velocity": first(velocity),
    }
    track = Track(jnp.asarray(STEP), jnp.zeros(count * length), measured)
    rows = jnp.arange(count) * length
    everywhere = jnp.arange(count * length)
    if hidden is None:
        carried = jax.vmap(lambda row: start_at_rest(machine, track, row))(everywhere)
    else:
        carried = jax.tree.map(lambda values: jnp.repeat(values, length, axis=0), hidden)
    angles = predict(machine, track, rows, samples=length, imposed=("pressure",), substeps=4, hidden=carried)
    return angles["angle"][:, -1]


def rms(values: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))
