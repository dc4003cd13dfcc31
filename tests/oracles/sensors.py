"""What sensors say of the true values: lag, nonlinearity, backlash, gain, offset, drift."""

import numpy as np
from oracles.driven import lagged
from oracles.outside import misread
from oracles.plays import behind_play

LAGS = {"pressure_sensor_lag": "pressure", "force_sensor_lag": "force"}
BACKLASH = ("position", "angle")
AMBIENT = 101325.0
FINE = 50
"""Substeps to a time constant of a lag."""


def readings(effects, values, step):
    """What is read of true `values`, by column (SI), every `step` seconds.

    Lag: τ dy/dt = value - y, settled at first, of each column that begins with pressure or force. Force:
    y + c y³. Backlash: a play operator of the half width, at rest in its middle. Then, of the one column that
    the effect names: y + gain (y - y0), y + offset, y + rate t. y0: what the sensor shows unloaded; pressures
    are absolute, their sensors show zero in the open.
    """
    return {name: np.asarray(_reading(effects, name, true, step)) for name, true in values.items()}


def _reading(effects, name, true, step):
    for lag, kind in LAGS.items():
        if lag in effects and name.startswith(kind):
            time_constant = effects[lag]["time_constant"]
            true = lagged(true, step, time_constant, int(np.ceil(FINE * step / time_constant)))
    if name == "force" and (bent := effects.get("force_sensor_nonlinearity")):
        true = true + bent["cubic"] * true**3
    if name in BACKLASH and (slack := effects.get("backlash")):
        true = behind_play(true, slack["half_width"], true[0])
    own = {e: v for e, v in effects.items() if v.get("column") == name}
    if gain := own.get("sensor_gain"):
        unloaded = AMBIENT if name.startswith("pressure") else 0.0
        true = true + gain["gain"] * (true - unloaded)
    if off := own.get("sensor_offset"):
        true = true + off["offset"]
    if drift := own.get("sensor_drift"):
        true = true + drift["rate"] * step * np.arange(len(true))
    return misread(own, true, step * np.arange(len(true)))
