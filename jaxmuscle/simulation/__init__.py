"""Simulation of an actuator on its sample clock: one run, the observer of its hidden states, predictions
of windows.
"""

from jaxmuscle.simulation.run import Feedback, Run, observe, predict, run
from jaxmuscle.simulation.simulation_state import SimulationState
from jaxmuscle.simulation.track import Restarts, Start, Track, held_at, start_at_rest, with_states

__all__ = [
    "Feedback",
    "Restarts",
    "Run",
    "SimulationState",
    "Start",
    "Track",
    "held_at",
    "observe",
    "predict",
    "run",
    "start_at_rest",
    "with_states",
]
