"""A machine on its sample clock: one run, the observer of its hidden states, predictions of windows."""

from jaxmuscle.simulation.feedback import Feedback
from jaxmuscle.simulation.run import Run, run
from jaxmuscle.simulation.track import Restarts, Start, Track, held_at, start_at_rest, with_states
from jaxmuscle.simulation.windows import observe, predict

__all__ = [
    "Feedback",
    "Restarts",
    "Run",
    "Start",
    "Track",
    "held_at",
    "observe",
    "predict",
    "run",
    "start_at_rest",
    "with_states",
]
