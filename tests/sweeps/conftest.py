"""A machine, a command and a clock that the tests of sweeps share: what is compiled is compiled once."""

import numpy as np
import pytest

import jaxmuscle as jm
from jaxmuscle.actuators.actuator import AbstractActuator

CLOCK = np.arange(80) * 0.002
REDUCTIONS = ("maximum", "final")


@pytest.fixture(scope="session")
def machine() -> AbstractActuator:
    return jm.actuator(jm.read(jm.sample("lift")).card)


@pytest.fixture(scope="session")
def sine() -> jm.commands.Sine:
    return jm.commands.Sine(amplitude=2.0, mean=1.0, frequency=5.0)
