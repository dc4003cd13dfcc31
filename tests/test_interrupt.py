"""Ctrl-C ends the real program at once, and nothing is left half-written."""

import os
import signal
import subprocess
import sys
import time

import pytest

from jaxmuscle.cli import INTERRUPTED

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
