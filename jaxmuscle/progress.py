"""Progress of long jobs and their interruption: what a job is at, the time it still takes, Ctrl-C."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

PRIOR_SECONDS = 10.0
"""Work that counts as done at the expected speed before anything is done: the first guesses are no jumps."""


@dataclasses.dataclass(frozen=True)
class Progress:
    """A report of progress; its text is a line for people.

    Attributes:
        doing: what is being done, in words.
        fraction: part of the whole work that is done, 0 to 1, never less than in the report before.
        seconds_left: estimate of the time that the rest takes [s].
    """

    doing: str
    fraction: float
    seconds_left: float

    def __str__(self) -> str:
        return f"{self.doing} ({self.fraction:.0%}, about {in_words(self.seconds_left)} left)"


class Stopped(Exception):  # noqa: N818  it is no error: the user wanted it
    """The job was told to end."""


class Meter:
    """Counts work that is done and tells how far the whole is. Threads may share it.

    Work is counted in seconds that it takes on two cores of a common machine; the estimate of the time left
    follows the speed that is seen.
    """

    def __init__(self, tell: Callable[[Progress], None]) -> None:
        """Begin now; `tell` gets every report."""
        self.tell = tell
        self.begin = time.monotonic()
        self.total = self.done = self.fraction = 0.0
        self.stopped = False
        self._lock = threading.Lock()

    def expect(self, work: float) -> None:
        """Count further work to the whole."""
        self.total += work

    def did(self, work: float, doing: str) -> None:
        """Report that `work` is done and what is being done now.

        Raises:
            Stopped: :meth:`stop` was called.
        """
        if self.stopped:
            raise Stopped
        with self._lock:
            self.done += work
            rest = max(self.total - self.done, 0.0)
            self.fraction = max(self.fraction, self.done / max(self.done + rest, 1e-9))
            speed = (self.done + PRIOR_SECONDS) / (time.monotonic() - self.begin + PRIOR_SECONDS)
            report = Progress(doing, self.fraction, rest / speed)
            self.tell(report)

    def had(self, work: float, doing: str) -> None:
        """Report that `work` was done in an earlier run: the speed that is seen stays as it is."""
        with self._lock:
            self.begin -= work
        self.did(work, doing)

    def skip_to(self, rest: float, doing: str) -> None:
        """Report that no more than the work `rest` is left: parts that had been expected were not needed."""
        self.did(max(self.total - self.done - rest, 0.0), doing)

    def stop(self) -> None:
        """Have the job end where it next reports."""
        self.stopped = True


def in_words(seconds: float) -> str:
    """A time for people: "5 s", "2 min"."""
    return f"{seconds:.0f} s" if seconds < 99.5 else f"{seconds / 60:.0f} min"


Result = TypeVar("Result")

LISTENING = 0.1
"""Seconds between two looks for a Ctrl-C: a wait without end does not hear it on every system."""


def interruptible(work: Callable[[], Result], stop: Callable[[], None]) -> Result:
    """What `work` gives, computed in a thread of its own while this one listens for Ctrl-C.

    A program of XLA holds the thread that calls it until it ends, up to a minute where it compiles. After a
    `KeyboardInterrupt`, which is raised here at once, `work` goes on to where it next asks whether it is to
    stop. Python runs handlers of signals in the main thread alone: called from another one, `work` is
    done there. Exceptions of `work` are raised here.

    Args:
        stop: called after a Ctrl-C; has `work` end soon.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    outcome: dict[str, Any] = {}

    def run() -> None:
        try:
            outcome["result"] = work()
        except BaseException as error:
            outcome["error"] = error

    thread = threading.Thread(target=run, name="jaxmuscle", daemon=True)
    try:
        thread.start()
        while thread.is_alive():
            thread.join(LISTENING)
    except BaseException:
        stop()
        raise
    if "error" in outcome:
        raise outcome["error"]
    return outcome["result"]
