"""Work that Ctrl-C ends at once, although XLA does not listen while it compiles or computes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

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
