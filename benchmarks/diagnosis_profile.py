"""Where does the time of a diagnosis go: tracing, compiling or running, in which phase, in which program?

What JAX traces, lowers and compiles is told by its monitoring events, exactly. What runs is seen by looking
at the stacks of all threads every few milliseconds. Seconds are those of threads: two threads that work side
by side count twice, and one that waits for another does not count.
"""

from __future__ import annotations

import collections
import dataclasses
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import jax

import jaxmuscle as jm
from jaxmuscle.diagnosis import Diagnosis
from jaxmuscle.formatting import aligned
from jaxmuscle.progress import Progress

PERIOD = 0.01
"""Seconds between two looks at the stacks."""
KINDS = {
    "/jax/core/compile/jaxpr_trace_duration": "trace",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lower",
    "/jax/core/compile/backend_compile_duration": "compile",
}
READ = "/jax/compilation_cache/cache_retrieval_time_sec"
"""Reading a program that was compiled by an earlier process; part of the event of a compilation."""
PREPARED, SEARCH, JUDGED = "preparation", "search", "judgement on folds"
PHASES = {"fitting the declared": "declared fit", "adding": "refit", "predicting": "conclusion"}
"""First words of a progress report → the phase that begins with it, outside of searches and judgements."""
COLUMNS = ("trace", "lower", "compile", "run")
Cell = tuple[str, str]


@dataclasses.dataclass
class Span:
    """Work on one program in one thread, without what other spans inside it have taken over."""

    kind: str
    program: str
    phase: str
    begin: float
    seconds: float


class Profile:
    """Collects spans and samples while it is entered; `tell` takes the progress reports of a diagnosis."""

    def __init__(self) -> None:
        self.spans: dict[int, list[Span]] = collections.defaultdict(list)
        self.busy: collections.Counter[str] = collections.Counter()
        self.running: collections.Counter[Cell] = collections.Counter()
        self.read = 0
        self.wall = self.processor = 0.0
        self.phase = PREPARED
        self._ended = threading.Event()
        self._sampler = threading.Thread(target=self._sample, daemon=True)

    def __enter__(self) -> Profile:
        jax.monitoring.register_event_duration_secs_listener(self._listen)
        self.wall, self.processor = -time.perf_counter(), -time.process_time()
        self._sampler.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.wall += time.perf_counter()
        self.processor += time.process_time()
        self._ended.set()
        self._sampler.join()
        jax.monitoring.unregister_event_duration_listener(self._listen)

    def tell(self, progress: Progress) -> None:
        """Take a report of the diagnosis."""
        for words, phase in PHASES.items():
            if progress.doing.startswith(words):
                self.phase = phase

    def _listen(self, event: str, duration_secs: float, **kwargs: Any) -> None:
        """An event is told when it ends; those inside it have been told before and are part of it."""
        self.read += event == READ
        if event not in KINDS:
            return
        begin, phase = time.perf_counter() - duration_secs, self._phase_of(_stack(sys._getframe(1)))
        spans = self.spans[threading.get_ident()]
        while spans and spans[-1].begin >= begin:
            spans.pop()
        program = str(kwargs.get("fun_name", "?")).removeprefix("jit_").removeprefix("jit(").removesuffix(")")
        spans.append(Span(KINDS[event], program, phase, begin, duration_secs))

    def _sample(self) -> None:
        last = time.perf_counter()
        while not self._ended.wait(PERIOD):
            now, frames = time.perf_counter(), sys._current_frames()
            for frame in frames.values():
                stack = _stack(frame)
                if _at_work(stack):
                    phase = self._phase_of(stack)
                    self.busy[phase] += now - last  # pyright: ignore[reportArgumentType]
                    program = _program(stack)
                    if program and not _in_compiler(stack):
                        self.running[phase, program] += now - last  # pyright: ignore[reportArgumentType]
            last = now

    def _phase_of(self, stack: list[FrameType]) -> str:
        for frame in stack:
            if frame.f_code.co_name == "search" and "effect" in frame.f_locals:
                return f"{SEARCH} {frame.f_locals['effect'].name}"
            if frame.f_code.co_name in ("judge", "judged"):
                return JUDGED
        return self.phase

    def phases(self) -> list[dict[str, Any]]:
        """A row for each phase: busy seconds and how they split."""
        rows: dict[str, dict[str, float]] = {phase: dict.fromkeys(COLUMNS, 0.0) for phase in self.busy}
        for span in self._all():
            row = rows.setdefault(span.phase, dict.fromkeys(COLUMNS, 0.0))
            row[span.kind] += span.seconds
        for (phase, _), seconds in self.running.items():
            rows[phase]["run"] += seconds
        return [{"phase": phase, "busy": self.busy[phase], **row} for phase, row in rows.items()]

    def programs(self) -> list[dict[str, Any]]:
        """A row for each program, by its name: how often it was compiled, and its seconds."""
        rows: dict[str, dict[str, Any]] = {}
        empty = {"compiled": 0, **dict.fromkeys(COLUMNS, 0.0)}
        for span in self._all():
            row = rows.setdefault(span.program, {"program": span.program, **empty})
            row["compiled"] += span.kind == "compile"
            row[span.kind] += span.seconds
        for (_, program), seconds in self.running.items():
            rows.setdefault(program, {"program": program, **empty})["run"] += seconds
        return sorted(rows.values(), key=lambda row: -sum(row[k] for k in COLUMNS))

    def _all(self) -> Iterator[Span]:
        for spans in self.spans.values():
            yield from spans


def profiled(path: Path, diagnose: Callable[..., Diagnosis] = jm.diagnose) -> tuple[Profile, Diagnosis]:
    """Diagnose a recording under a profile."""
    with Profile() as profile:
        found = diagnose(jm.read(path), progress=profile.tell)
    return profile, found


def written(name: str, profile: Profile, most: int = 14) -> str:
    """Both tables as text, the `most` expensive programs; the others are summed up."""
    phases, programs = profile.phases(), profile.programs()
    total = {key: sum(row[key] for row in phases) for key in ("busy", *COLUMNS)}
    rest = programs[most:]
    if rest:
        sums = {k: sum(row[k] for row in rest) for k in ("compiled", *COLUMNS)}
        programs = [*programs[:most], {"program": f"{len(rest)} others", **sums}]
    head = (
        f"{name}: {profile.wall:.1f} s wall, {profile.processor:.1f} s of processors; "
        f"{sum(row['compiled'] for row in programs)} programs compiled or read, {profile.read} of them read"
    )
    return "\n\n".join(
        [head, _text([*phases, {"phase": "all", **total}]), _text(programs)],
    )


def _text(rows: list[dict[str, Any]]) -> str:
    heads = list(rows[0])
    cells = [[f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()] for row in rows]
    return aligned(heads, cells)


def _stack(frame: FrameType | None) -> list[FrameType]:
    """Frames of a thread, the outermost first."""
    frames = []
    while frame is not None:
        frames.append(frame)
        frame = frame.f_back
    return frames[::-1]


def _at_work(stack: list[FrameType]) -> bool:
    """Whether a thread works for the diagnosis and does not wait for another."""
    inside = any("jaxmuscle/diagnosis/" in frame.f_code.co_filename.replace("\\", "/") for frame in stack)
    return inside and not stack[-1].f_code.co_filename.endswith(("threading.py", "_base.py", "thread.py"))


def _in_compiler(stack: list[FrameType]) -> bool:
    """Whether a thread traces, lowers or compiles: what JAX does in Python below the call of a program."""
    names = {frame.f_code.co_name for frame in stack}
    return not names.isdisjoint({"trace_to_jaxpr", "_trace_for_jit", "backend_compile_and_load",
                                 "lower_jaxpr_to_module", "_infer_params", "_pjit_call_impl_python",
                                 "_cached_compilation", "_infer_params_internal"})  # fmt: skip


def _program(stack: list[FrameType]) -> str | None:
    """Name of the compiled function that a thread is in, or waits for the result of."""
    for frame in stack:
        if frame.f_code.co_name == "_call" and "_jit" in frame.f_code.co_filename:
            return getattr(frame.f_locals.get("jit_wrapper"), "__name__", "?")
    last = stack[-1].f_code
    return "waiting for results" if last.co_name in ("_value", "__array__", "asarray") else None
