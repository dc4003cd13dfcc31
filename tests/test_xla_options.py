"""Options of XLA that jaxlib 0.10 needs: when they are written, and what they do."""

import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

from jaxmuscle import xla_options
from jaxmuscle.xla_options import (
    CAREFUL,
    LOG,
    SMALL,
    WHOLE,
    add_options,
    compact,
    needed,
    present,
    remove_options,
    written,
)  # fmt: skip

LOOP = """
import {first}, {second}
import jax.numpy as jnp
loop = jax.jit(lambda x: jax.lax.scan(lambda c, _: (jnp.sin(c) + c[::-1], c), x, length=1000)[1])
print("xla_cpu_small_call" in loop.lower(jnp.ones(40)).compile().as_text(), jnp.ones(1).dtype)
"""
NEEDED = pytest.mark.skipif(not needed(), reason="this jaxlib needs no options, and gets none")
OWN = f"--xla_backend_extra_options={SMALL}=0"


@NEEDED
@pytest.mark.parametrize(("first", "second"), [("jax", "jaxmuscle"), ("jaxmuscle", "jax")])
@pytest.mark.parametrize(("given", "whole"), [("", True), (OWN, False)])
def test_a_loop_is_compiled_as_a_whole_unless_the_user_says_otherwise(first, second, given, whole):
    environment = {**os.environ, "XLA_FLAGS": given, "JAX_ENABLE_COMPILATION_CACHE": "false"}
    program = LOOP.format(first=first, second=second)
    told = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == [str(whole), "float64"]


def test_other_options_are_kept():
    flags = {"XLA_FLAGS": "--xla_cpu_enable_fast_math=false"}
    add_options(flags, None)
    assert flags["XLA_FLAGS"].split() == ["--xla_cpu_enable_fast_math=false", *written(WHOLE)]
    assert flags[LOG] == "2"
    once = dict(flags)
    add_options(flags, None)
    assert flags == once


@pytest.mark.parametrize("option", {**WHOLE, **CAREFUL})
def test_an_option_of_the_user_is_not_mixed_with_ours(option):
    flags = {"XLA_FLAGS": f"{option}=x"}
    add_options(flags, None)
    assert flags == {"XLA_FLAGS": f"{option}=x"}


def test_careful_where_warnings_are_wanted_or_there_is_an_accelerator(monkeypatch):
    """XLA would warn of every intermediate result; and an accelerator's memory is not to be wasted."""
    wanted = {LOG: "0"}
    add_options(wanted, None)
    assert wanted["XLA_FLAGS"].split() == written(CAREFUL) and wanted[LOG] == "0"
    monkeypatch.setattr(xla_options, "find_spec", lambda name: name == "jax_plugins")
    beside = {}
    add_options(beside, None)
    assert beside["XLA_FLAGS"].split() == written(CAREFUL) and LOG not in beside


@pytest.mark.parametrize(
    ("variable", "value", "options"),
    [
        (LOG, "", CAREFUL), (LOG, "ERROR", CAREFUL), (LOG, "1", CAREFUL), (LOG, "3", WHOLE),
        ("JAX_LOGGING_LEVEL", "DEBUG", CAREFUL), ("JAX_LOGGING_LEVEL", "ERROR", WHOLE),
    ],
)  # fmt: skip
def test_a_level_of_the_user_stays(variable, value, options):
    """Whatever it is: a word where XLA expects a number does not end the program."""
    flags = {variable: value}
    add_options(flags, None)
    assert flags["XLA_FLAGS"].split() == written(options) and flags[variable] == value


@pytest.mark.parametrize(
    ("level", "given", "options"),
    [
        ("NOTSET", "1", WHOLE), (None, "1", WHOLE), ("DEBUG", "1", CAREFUL), ("NOTSET", "0", CAREFUL),
        ("NOTSET", "2", WHOLE), ("CRITICAL", "1", WHOLE), ("NOTSET", "loud", CAREFUL),
    ],
)  # fmt: skip
def test_warnings_of_a_jax_that_is_there_already(level, given, options):
    """Its own level is put back; one that the user has set is not touched."""
    updates = []
    config = SimpleNamespace(jax_logging_level=level, update=lambda *pair: updates.append(pair))
    flags = {LOG: given}
    add_options(flags, SimpleNamespace(config=config))
    assert flags["XLA_FLAGS"].split() == written(options)
    ours = given == "1" and level in (None, "NOTSET")
    told = [("jax_logging_level", "ERROR"), ("jax_logging_level", level)] if ours else []
    assert updates == told
    assert flags[LOG] == ("2" if ours else given)


DERIVATIVES = """
import {first}, {second}
import jax.numpy as jnp
def loop(x):
    def body(carry, _):
        a, b = carry
        a = jnp.sin(a @ jnp.outer(b, b)) + b
        return (a, jnp.cos(b) * a.sum()), a
    return jax.lax.scan(body, (x, x[::-1]), length=50)[1]
jax.jit(jax.jacfwd(loop))(jnp.ones(6))
"""


@NEEDED
@pytest.mark.parametrize(("first", "second"), [("jax", "jaxmuscle"), ("jaxmuscle", "jax")])
def test_intermediate_results_lie_apart_and_nothing_is_said_of_it(tmp_path, first, second):
    """No two buffers of unlike place may overlap: what XLA tells LLVM of them is then true."""
    environment = {**os.environ, "XLA_FLAGS": f"--xla_dump_to={tmp_path} --xla_dump_hlo_as_text"}
    environment |= {"JAX_ENABLE_COMPILATION_CACHE": "false"}
    environment.pop(LOG, None)
    program = DERIVATIVES.format(first=first, second=second)
    told = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert "per-heap" not in told.stderr
    (path,) = tmp_path.glob("*jit_loop*buffer-assignment.txt")
    heaps = re.split(r"\nallocation ", path.read_text())
    temporary = [heap for heap in heaps if "preallocated-temp" in heap.split("\n")[0]]
    places = [set(re.findall(r"\(size=\d+,offset=\d+\)", heap)) for heap in temporary]
    assert len(places) > 5 and all(len(each) == 1 for each in places)


@NEEDED
@pytest.mark.parametrize(("first", "second"), [("jax", "jaxmuscle"), ("jaxmuscle", "jax")])
def test_processes_begun_by_this_one_are_as_quiet(first, second):
    """They inherit the options: workers had filled the screen with warnings."""
    environment = {**os.environ, "XLA_FLAGS": "", "JAX_ENABLE_COMPILATION_CACHE": "false"}
    environment.pop(LOG, None)
    inner = DERIVATIVES.format(first=first, second=second)
    program = f"import {first}, {second}, subprocess, sys\n"
    program += f"subprocess.run([sys.executable, '-c', {inner!r}], check=True)"
    told = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert "per-heap" not in told.stderr


@pytest.mark.parametrize(("release", "wanted"), [("0.10.2", True), ("0.12.0.1", False), ("0.99.0", False)])
def test_only_jaxlib_0_10_gets_options(monkeypatch, release, wanted):
    """The next ones are as fast without; and XLA ends the program at an option that it does not know."""
    monkeypatch.setattr(xla_options, "version", lambda _: release)
    assert needed() is wanted
    assert (compact() is not None) is wanted


def test_what_was_added_can_be_taken_out():
    flags = {"XLA_FLAGS": "--xla_cpu_enable_fast_math=false"}
    add_options(flags, None)
    assert list(present(flags)) == written(WHOLE)
    remove_options(flags)
    assert flags["XLA_FLAGS"] == "--xla_cpu_enable_fast_math=false" and present(flags) == ()
    alone = {}
    add_options(alone, None)
    remove_options(alone)
    assert "XLA_FLAGS" not in alone
    remove_options(alone)
    assert "XLA_FLAGS" not in alone
