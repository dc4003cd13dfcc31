"""What importing the package sets in JAX, and what `jaxmuscle.configure` says and switches.

Options of XLA that jaxlib 0.10 needs: when they are written, and what they do.
"""

import json
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest

import jaxmuscle
from jaxmuscle import _config
from jaxmuscle._config import (
    CAREFUL,  # fmt: skip
    LOG,
    SMALL,  # fmt: skip
    WHOLE,  # fmt: skip
    X64,
    add_options,  # fmt: skip
    needed,
    prepare,
    present,  # fmt: skip
    remove_options,  # fmt: skip
    written,  # fmt: skip
)
from jaxmuscle.errors import InputError

ORDERS = pytest.mark.parametrize(("first", "second"), [("jax", "jaxmuscle"), ("jaxmuscle", "jax")])
CLEAN = {k: v for k, v in os.environ.items() if k not in (X64, "XLA_FLAGS", LOG)}
"""The environment of a process that no jaxmuscle has prepared."""


def printed(program: str, **environment: str) -> list[str]:
    """Lines that a program prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**CLEAN, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


@ORDERS
def test_double_precision_whichever_is_imported_first(first, second):
    program = f"import {first}, {second}\nimport jax.numpy as jnp\nprint(jnp.ones(1).dtype)"
    assert printed(program) == ["float64"]


@ORDERS
def test_a_precision_that_the_user_has_set_stays(first, second):
    program = f"import {first}, {second}\nimport jax.numpy as jnp\nprint(jnp.ones(1).dtype)"
    assert printed(program, **{X64: "0"}) == ["float32"]


@ORDERS
def test_no_variable_is_written_that_other_programs_inherit(first, second):
    """But the options that jaxlib 0.10 needs."""
    program = (
        f"import os\nbefore = dict(os.environ)\nimport {first}, {second}, json\n"
        "print(json.dumps(sorted(k for k in os.environ if os.environ[k] != before.get(k))))"
    )
    (written,) = printed(program)
    ours = {"XLA_FLAGS", LOG} if needed() else set()
    # What JAX itself writes as it is imported is not ours.
    (own,) = printed(program.replace(f"{first}, {second}", "jax"))
    assert set(json.loads(written)) - ours == set(json.loads(own)) - ours


def test_configure_says_and_switches_precision():
    program = (
        "import jaxmuscle, jax.numpy as jnp\n"
        "print(jaxmuscle.configure().x64, jnp.ones(1).dtype)\n"
        "print(jaxmuscle.configure(x64=False).x64, jnp.ones(1).dtype)\n"
        "print(jaxmuscle.configure(x64=True).x64, jnp.ones(1).dtype)"
    )
    assert printed(program) == ["True float64", "False float32", "True float64"]


def test_configure_takes_the_options_out_and_puts_them_back():
    program = (
        "import jaxmuscle, os\n"
        "print(len(jaxmuscle.configure().xla_options), os.environ['XLA_FLAGS'].split()[0])\n"
        "print(len(jaxmuscle.configure(xla_options=False).xla_options), os.environ['XLA_FLAGS'])\n"
        "print(len(jaxmuscle.configure(xla_options=True).xla_options))"
    )
    own = "--xla_cpu_enable_fast_math=false"
    given, taken, back = printed(program, XLA_FLAGS=own)
    assert given == f"{2 if needed() else 0} {own}"
    assert taken == f"0 {own}"
    assert back == ("2" if needed() else "0")


@pytest.mark.skipif(not needed(), reason="this jaxlib needs no options, so there is nothing to switch")
def test_options_come_too_late_after_a_computation():
    program = (
        "import jaxmuscle, jax.numpy as jnp\njnp.ones(1)\n"
        "try:\n    jaxmuscle.configure(xla_options=False)\n"
        "except jaxmuscle.InputError as error:\n    print(error)"
    )
    (told,) = printed(program)
    assert "before JAX computes" in told


@pytest.mark.slow
def test_single_precision_is_refused_where_it_would_spoil_the_answer():
    program = (
        "import jaxmuscle as jm\njm.configure(x64=False)\n"
        "lift = jm.read(jm.sample('lift'))\n"
        "for verb in (lambda: jm.diagnose(lift), lambda: jm.fit(jm.actuator(lift.card), lift)):\n"
        "    try:\n        verb()\n"
        "    except jm.InputError as error:\n        print(error)"
    )
    told = printed(program)
    assert len(told) == 2 and all("configure(x64=True)" in line for line in told)


def test_an_untested_jaxlib_is_told_once_at_import(monkeypatch):
    monkeypatch.setattr(_config, "version", lambda _: "0.99.0")
    updates = []
    config = SimpleNamespace(update=lambda *pair: updates.append(pair), jax_logging_level=None)
    with pytest.warns(UserWarning, match=r"tested with jaxlib .*; 0\.99\.0 is installed"):
        prepare({}, {"jax": SimpleNamespace(config=config)})
    assert ("jax_enable_x64", True) in updates


def test_this_jaxlib_is_tested():
    assert jaxmuscle.configure().tested


def test_only_one_finder_waits_for_jax(monkeypatch):
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    before = len(sys.meta_path)
    for _ in range(2):
        prepare({}, {})
    assert len(sys.meta_path) == before + 1
    assert sys.meta_path[0].find_spec("numpy", None) is None


def test_double_precision_is_there_here():
    _config.require_double_precision("this test")


def test_refusal_names_what_cannot_be_done(monkeypatch):
    monkeypatch.setattr("jax.config.read", lambda name: False)
    with pytest.raises(InputError, match="a fit needs double precision"):
        _config.require_double_precision("a fit")


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
    monkeypatch.setattr(_config, "find_spec", lambda name: name == "jax_plugins")
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
    monkeypatch.setattr(_config, "version", lambda _: release)
    assert needed() is wanted


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
