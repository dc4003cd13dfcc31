"""How much work the parts of a diagnosis are, for its progress.

In seconds of the sample `lift` on two cores, from nothing compiled; most of it is compilation, so that what
has been compiled in an earlier round is far less. Other rigs take longer in all parts alike.
"""

from __future__ import annotations

from collections.abc import Sequence

from jaxmuscle.diagnosis.candidates import carries_state
from jaxmuscle.effects.base import AbstractEffect

DECLARED = 8.0
"""First fit of the declared model; two more, which cost next to nothing then."""
CONCLUSION = 8.0
"""Held-out predictions, standard deviations, what is unexplained."""
SEARCH, SEARCH_WITH_STATE = 0.8, 14.0
"""Search of one candidate; one with a state of its own has to be compiled for itself."""
COMPILED = 0.2
"""Part of that when its programs are there."""
SEARCH_STEPS = (0.7, 0.1, 0.1, 0.1)
"""Parts of a search: first start, short fit from it, second start, fits to the end. The first is compiled."""
JUDGEMENT = 0.25
"""A fit to one fold, and its judgement."""
REFIT = 0.5


def search_work(effect: type[AbstractEffect], again: bool) -> float:
    """Work of the search of one candidate, in the first round or `again` in a later one."""
    return (SEARCH_WITH_STATE if carries_state(effect) else SEARCH) * (COMPILED if again else 1.0)


def round_work(effects: Sequence[type[AbstractEffect]], folds: int, again: bool) -> float:
    """Work of a round that tries `effects` and judges them, and the model without them, on `folds` folds."""
    searched = sum(search_work(effect, again) for effect in effects)
    return searched + JUDGEMENT * folds * (len(effects) + 1)
