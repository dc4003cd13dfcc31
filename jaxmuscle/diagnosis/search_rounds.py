"""What a result tells of one search: its candidates in order, and which was added."""

from __future__ import annotations

from jaxmuscle.diagnosis.candidates import signal_of
from jaxmuscle.diagnosis.diagnosis_data import Alternative, Round
from jaxmuscle.diagnosis.ranking import Candidate, Ranking, told_apart


def round_of(ranking: Ranking, best: Candidate | None) -> Round:
    """The round of a ranking of which the `best` was added, or nothing."""
    first = ranking.candidates[0]
    entries = tuple(
        Alternative(
            candidate.name,
            signal_of(candidate.effects[0]),
            candidate.evidence.gain,
            candidate.evidence.p_value,
            candidate.evidence.loss,
            not candidate.judged or told_apart(candidate, first, ranking.stretch),
            candidate.judged,
            candidate.evidence.test,
            candidate.evidence.stretches,
            candidate.failed,
        )
        for candidate in ranking.candidates
    )
    return Round(ranking.loss, entries, best.name if best else None)
