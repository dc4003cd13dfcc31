"""What importing the package sets in JAX, and what `jaxmuscle.configure` says and switches."""

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

import jaxmuscle
from jaxmuscle import configuration
from jaxmuscle.configuration import X64, prepare
from jaxmuscle.errors import InputError
from jaxmuscle.xla_options import LOG, needed

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
    monkeypatch.setattr(configuration, "version", lambda _: "0.99.0")
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
    configuration.require_double_precision("this test")


def test_refusal_names_what_cannot_be_done(monkeypatch):
    monkeypatch.setattr("jax.config.read", lambda name: False)
    with pytest.raises(InputError, match="a fit needs double precision"):
        configuration.require_double_precision("a fit")
