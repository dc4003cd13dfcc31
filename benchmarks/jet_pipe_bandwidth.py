"""Bandwidths of [H]: Figure 4.12 by linearisation, Figures 3.15 and 3.16 by simulation."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jet_pipe_rows import BANDWIDTHS, CORNER, ZERO, actuator
from published_rows import OWN, WORDS, Row, aside, half_digit, row

import jaxmuscle as jm
from jaxmuscle.actuators import JetPipeActuator
from jaxmuscle.analysis import equilibrium_at, linearise
from jaxmuscle.parameters import replace

STOPPERS = np.linspace(0.036, 0.090, 10)
FORCES = np.array([15.0, 30.0, 45.0, 60.0])


@cache
def over_stoppers(chamber_2: float | None = None, supply: float | None = None) -> dict[str, np.ndarray]:
    """Open-loop bandwidth and dominant fluid pole [Hz] over stoppers and forces, in one vmapped call.

    `chamber_2`: its length [m], if it is not to shrink as chamber 1 grows; `supply`: absolute pressure [Pa],
    if it is not to be that of 80 psig.
    """

    def at(stopper: Any, force: Any) -> dict[str, Any]:
        longer = {} if chamber_2 is None else {"cylinder.free_length": stopper - 0.026 + chamber_2}
        other = {} if supply is None else {"receiver.supply_pressure": supply}
        machine = replace(actuator(), {"stopper_position": stopper, **longer, **other})
        point = equilibrium_at(machine, "force", force, command=1.0)
        model = linearise(machine, point)
        corner, pole = model.bandwidth("force"), -model.poles()[1].real
        hertz = {"bandwidth": corner / (2 * jnp.pi), "pole": pole / (2 * jnp.pi)}
        return {**hertz, "converged": point.converged}

    found = jax.jit(jax.vmap(jax.vmap(at, (None, 0)), (0, None)))(STOPPERS, FORCES)
    return {name: np.asarray(values) for name, values in found.items()}


def power(values: np.ndarray) -> float:
    """Exponent of chamber 1's volume in a bandwidth over the stoppers."""
    return float(np.polyfit(np.log(STOPPERS - 0.026), np.log(values), 1)[0])


def bandwidth_rows() -> Iterator[Row]:
    found, alone, source = over_stoppers(), over_stoppers(0.042), "[H] Figure 4.12"
    middle = found["bandwidth"][(STOPPERS > 0.039) & (STOPPERS < 0.082)]
    ends = [float(middle.min()), float(middle.max())]
    ok = ends[0] > BANDWIDTHS[0] / 2 and ends[1] < BANDWIDTHS[1] * 2
    linear = row("[H] 3.3.2", "linear open-loop bandwidths over stopper and force", "0.8 to 2.8", ends, ok,
                 "Hz", "a factor of two", "measured, at mid-stroke, over means and amplitudes")  # fmt: skip
    yield aside(linear, OWN)
    for what, why in (("bandwidth", CORNER), ("pole", "")):
        mine, here = power(alone[what][:, 2]), found[what][2:5, 1:].mean(0)
        name = {"bandwidth": "-3 dB bandwidth", "pole": "dominant fluid pole"}[what]
        inverse = -1.25 < mine < -0.75
        volume = row(source, f"power of chamber 1's volume in the {name} at 45 N, chamber 2 kept",
                     "inversely proportional", mine, inverse, "", "-1, to 0.25", "in words", why)  # fmt: skip
        yield aside(volume, WORDS)
        rising = bool(np.all(np.diff(here) > 0))
        hertz = [float(x) for x in here]
        force = row(source, f"{name} at 30, 45, 60 N about mid-stroke", "increases with force", hertz, rising,
                    "Hz", "sign", "in words", why)  # fmt: skip
        yield aside(force, WORDS)


def responses(machine: JetPipeActuator) -> Any:
    """Gain [N/V] over frequency, mean and amplitude, of the full nonlinear model."""
    times = np.arange(0, 16, 4e-3)
    over = {
        "command.frequency": np.geomspace(0.25, 8, 11),
        "command.mean": np.array([0.8, 1.0, 1.3]),
        "command.amplitude": np.array([0.1, 0.3, 0.6]),
    }
    sine = jm.commands.Sine()
    return jm.sweep(machine, over, command=sine, times=times, outputs=["force"], reductions=["gain"])


def response_bandwidths(machine: JetPipeActuator) -> np.ndarray:
    """Frequency [Hz] at which the gain has fallen by 3 dB from that at 0.25 Hz, over mean and amplitude."""
    found = responses(machine)
    gain = np.asarray(found[next(iter(found.data_vars))])
    hertz = np.asarray(found["command.frequency"])
    fallen = np.log(gain / gain[0]) + 0.5 * np.log(2)
    first = np.argmax(fallen < 0, axis=0)
    low, high = (np.take_along_axis(fallen, k[None], 0)[0] for k in (first - 1, first))
    return hertz[first - 1] * (hertz[first] / hertz[first - 1]) ** (low / (low - high))


def response_rows() -> Iterator[Row]:
    hertz, source = response_bandwidths(actuator()), "[H] Figures 3.15, 3.16"
    ends = [float(hertz.min()), float(hertz.max())]
    allowed = half_digit("0.8")
    ok = all(abs(end - goal) <= allowed for end, goal in zip(ends, BANDWIDTHS, strict=True))
    # The means and amplitudes of the figures are not legible: these are not the experiments of [H].
    yield aside(
        row(source, "nonlinear open-loop bandwidths, three means by three amplitudes: least and largest",
            "0.8 to 2.8", ends, ok, "Hz", f"{allowed:g} at both ends", "means and amplitudes of our own",
            "the means and amplitudes of the figures are not legible; no hysteresis here"),
        OWN,
    )  # fmt: skip
    for what, found in (("mean", hertz[:, 1]), ("amplitude", hertz[1])):
        three = [float(x) for x in found]
        yield aside(
            row(source, f"bandwidth rises with the {what}", "slightly", three, three[2] > three[0], "Hz",
                "sign", "in words", ZERO),
            WORDS,
        )  # fmt: skip
