"""Causes that the catalogue does not have: forces on the load, and errors of sensors and supply."""

from math import pi, sin

import numpy as np


def push(effects, time, place, speed):
    """Force or torque on the load (along its motion) beside those of the machine.

    Cogging F sin(2π x / pitch); drag of the air -c v |v|; shaking of the frame F sin(2π f t); a weight that
    is put on at a time.
    """
    total = 0.0
    if cogs := effects.get("cogging"):
        total += cogs["force"] * sin(2 * pi * place / cogs["pitch"])
    if air := effects.get("air_drag"):
        total -= air["coefficient"] * speed * abs(speed)
    if frame := effects.get("shaking"):
        total += frame["force"] * sin(2 * pi * frame["frequency"] * time)
    if weight := effects.get("added_weight"):
        total -= weight["force"] * (time >= weight["time"])
    return total


def swinging(effects, supply, time):
    """Supply pressure of a compressor that comes and goes: p (1 + share sin(2π f t))."""
    swing = effects.get("supply_swing")
    return supply * (1 + swing["share"] * sin(2 * pi * swing["frequency"] * time)) if swing else supply


def misread(own, true, clock):
    """What a sensor says that has, of `own`: a ripple over what it reads, a hum, a zero that jumps.

    y + A sin(2π y / pitch); y + A sin(2π f t); y + jump from a time on.
    """
    if ripple := own.get("reading_ripple"):
        true = true + ripple["size"] * np.sin(2 * pi * true / ripple["pitch"])
    if hum := own.get("hum"):
        true = true + hum["size"] * np.sin(2 * pi * hum["frequency"] * clock)
    if jump := own.get("zero_jump"):
        true = true + jump["size"] * (clock >= jump["time"])
    return true
