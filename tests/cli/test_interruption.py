"""Ctrl-C ends the real program at once, with one line, and nothing is left half-written."""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pandas as pd
import pytest

from jaxmuscle.cli import INTERRUPTED
from jaxmuscle.samples import sample

SECONDS = 5.0
"""Far more than the end takes on a busy machine, far less than the compilation that is under way."""


@pytest.mark.usefixtures("interrupts")
@pytest.mark.skipif(os.name == "nt", reason="there, an interrupt cannot be sent to one process")
@pytest.mark.parametrize(
    "wait_for", ["fitting the declared model", pytest.param("trying", marks=pytest.mark.slow)]
)
def test_ctrl_c_ends_a_diagnosis_at_once(tmp_path, wait_for):
    """It had waited for all that was being compiled, 41 s."""
    program = subprocess.Popen(
        [sys.executable, "-m", "jaxmuscle.cli", "diagnose"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert program.stderr is not None
    for line in program.stderr:
        if wait_for in line:
            break
    time.sleep(1.0)
    assert program.poll() is None, "over before it could be interrupted"
    begin = time.monotonic()
    program.send_signal(signal.SIGINT)
    program.wait(60)
    took = time.monotonic() - begin
    assert program.returncode == INTERRUPTED
    assert took < SECONDS, f"{took:.1f} s"
    rest = program.stderr.read()
    assert "interrupted" in rest and "Traceback" not in rest
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert not written
    program.stderr.close()
    assert program.stdout is not None
    program.stdout.close()


FEW = """
import importlib
from jaxmuscle import cli, effects

module = importlib.import_module("jaxmuscle.diagnosis.diagnose")
module.CATALOGUE = (effects.LoadFriction, effects.Creep, effects.BladderStiffness, effects.LoadDamping)
module.EXTENSION, module.reading_effects = (), lambda rig: ()
cli.main()
"""
"""The program with a few effects to be tried."""


@pytest.mark.slow
@pytest.mark.usefixtures("interrupts")
@pytest.mark.skipif(os.name == "nt", reason="there, an interrupt cannot be sent to one process")
def test_the_same_command_goes_on_where_it_was(tmp_path, tmp_path_factory):
    """After Ctrl-C and after a kill; nothing but the finished fits is left meanwhile.

    Compiled programs are kept from one to the next, as they are for a user.
    """
    programs = str(tmp_path_factory.mktemp("programs"))
    kept = {"JAX_ENABLE_COMPILATION_CACHE": "true", "JAX_COMPILATION_CACHE_DIR": programs}

    def run(sent=None):
        with subprocess.Popen(
            [sys.executable, "-c", FEW, "diagnose", "--resume", "--no-report"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
            env={**os.environ, **kept, "PYTHONPATH": os.pathsep.join(sys.path)},
        ) as program:  # fmt: skip
            assert program.stderr is not None
            lines = []
            for line in program.stderr:
                lines.append(line.rstrip())
                if sent is not None and "judging" in line:
                    program.send_signal(sent)
                    sent = None
            return program.wait(60), lines, [path.name for path in tmp_path.iterdir()]

    def going_on(lines):
        return [int(line.split()[3]) for line in lines if line.startswith("going on with")]

    status, lines, files = run(signal.SIGINT)
    assert status == INTERRUPTED
    assert lines[-1] == "jaxmuscle: interrupted; the same command goes on where it was"
    assert files == ["jaxmuscle-lift.checkpoint.json"] and not going_on(lines)
    status, again, files = run(signal.SIGKILL)
    assert status == -signal.SIGKILL
    assert "jaxmuscle-lift.checkpoint.json" in files and len(files) <= 2, "and what was being written"
    tried = {line.split()[1] for line in lines if line.startswith("trying")}
    assert going_on(again)[0] >= len(tried) >= 4, "all that were searched before they were judged"
    status, last, files = run()
    assert status == 0, last
    assert going_on(last)[0] >= going_on(again)[0]
    assert files == ["jaxmuscle-lift"]


TALKING = """
import itertools, os, signal
from jaxmuscle.cli import console
from jaxmuscle.progress import interruptible

def work():
    with console.progress() as tell:
        for line in itertools.count():
            tell(f"line {line}")
            if line == 1000:
                os.kill(os.getpid(), signal.SIGINT)

try:
    interruptible(work, stop=lambda: None)
except KeyboardInterrupt:
    console.end_by_interrupt(told=False)
"""


@pytest.mark.usefixtures("interrupts")
@pytest.mark.skipif(os.name == "nt", reason="there, an interrupt cannot be sent to one process")
def test_nothing_is_told_after_the_interruption(tmp_path):
    """The work goes on to the end of the process; a line of it stood within the last one."""
    program = subprocess.run([sys.executable, "-c", TALKING], capture_output=True, text=True, cwd=tmp_path,
                             env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)})  # fmt: skip
    assert program.returncode == INTERRUPTED
    *lines, last = program.stderr.splitlines()
    assert last == "jaxmuscle: interrupted"
    assert len(lines) > 1000 and all(line.startswith("line ") for line in lines)


COMMANDS = {
    "diagnose": (("diagnose", "long.csv", "--card", "lift.toml", "--stretch", "all"), "reading"),
    "fit": (("fit", "long.csv", "--card", "lift.toml", "--stretch", "all"), "loading"),
    "check": (("check", "lift.toml", "--recording", "long.csv"), "begun"),
    "simulate": (("simulate", "lift.toml", "--command", "long.csv", "--plot"), "begun"),
    "sweep": (("sweep", "lift.toml", "--over", "mass=1:9:9000"), "begun"),
    "tune": (("tune", "lift.toml", "--reference", "wanted.csv"), "loading"),
}
"""Command → its arguments, and the line after which it is interrupted, of its progress or of `PROGRAM`."""
PROGRAM = """
import sys
from jaxmuscle import cli

app = cli.app

def begun():
    print("begun", file=sys.stderr, flush=True)
    app()

cli.app = begun
cli.main()
"""
"""The program; it tells when it begins, which Python takes a while to come to."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A card, a table that takes seconds to read, and a short one of a reference."""
    folder = tmp_path_factory.mktemp("inputs")
    lift = sample("lift")
    shutil.copyfile(lift.with_suffix(".toml"), folder / "lift.toml")
    rows = pd.concat([pd.read_csv(lift)] * 80, ignore_index=True)
    rows["t_s"] = np.round(0.002 * np.arange(len(rows)), 3)
    rows.to_csv(folder / "long.csv", index=False)
    rows.iloc[:500:50][["t_s", "x_mm"]].to_csv(folder / "wanted.csv", index=False)
    return folder


@pytest.mark.thorough
@pytest.mark.usefixtures("interrupts")
@pytest.mark.skipif(os.name == "nt", reason="there, an interrupt cannot be sent to one process")
@pytest.mark.parametrize("moment", [0.7, 4.0])
@pytest.mark.parametrize("name", COMMANDS)
def test_ctrl_c_ends_every_command_at_once(tmp_path, inputs, name, moment):
    """While it loads, reads a long table, compiles and computes; with one line, and nothing written."""
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    there = sorted(tmp_path.rglob("*"))
    arguments, wait_for = COMMANDS[name]
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as program:  # fmt: skip
        assert program.stderr is not None
        while wait_for not in program.stderr.readline():
            assert program.poll() is None, "it ended before it began"
        with contextlib.suppress(subprocess.TimeoutExpired):
            program.wait(moment)
        begin = time.monotonic()
        program.send_signal(signal.SIGINT)
        out, rest = program.communicate(timeout=60)
        took = time.monotonic() - begin
    assert took < SECONDS, f"{took:.1f} s"
    if program.returncode == 0 and "interrupted" not in rest:
        pytest.skip(f"over after {moment:g} s, before it could be interrupted")
    assert program.returncode == INTERRUPTED, rest
    assert rest.splitlines()[-1] == "jaxmuscle: interrupted" and rest.count("interrupted") == 1
    assert "Traceback" not in rest and "Traceback" not in out
    assert sorted(tmp_path.rglob("*")) == there


@pytest.mark.usefixtures("interrupts")
@pytest.mark.skipif(os.name == "nt", reason="there, an interrupt cannot be sent to one process")
def test_ctrl_c_after_the_work_is_done_does_no_harm():
    """Python's own end takes a moment; what is registered with `atexit` runs in it."""
    late = """
import atexit, os, signal, sys
from jaxmuscle.cli import main
atexit.register(os.kill, os.getpid(), signal.SIGINT)
sys.argv = ["jaxmuscle", "--version"]
main()
"""
    ended = subprocess.run(
        [sys.executable, "-c", late], capture_output=True, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert ended.returncode == 0 and ended.stderr == "", ended.stderr
    assert ended.stdout.startswith("jaxmuscle ")
