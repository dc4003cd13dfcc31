"""What importing the package sets in JAX and XLA."""

import os
import subprocess
import sys

import pytest

from jaxmuscle import settings
from jaxmuscle.settings import LOOPS, SMALL, prepare

LOOP = """
import {first}, {second}
import jax.numpy as jnp
loop = jax.jit(lambda x: jax.lax.scan(lambda c, _: (jnp.sin(c) + c[::-1], c), x, length=1000)[1])
print("xla_cpu_small_call" in loop.lower(jnp.ones(40)).compile().as_text(), jnp.ones(1).dtype)
"""
OWN = f"--xla_backend_extra_options={SMALL}=0"


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
    prepare(flags)
    assert flags["XLA_FLAGS"].split() == [
        "--xla_cpu_enable_fast_math=false",
        *(f"{k}={v}" for k, v in LOOPS.items()),
    ]
    once = dict(flags)
    prepare(flags)
    assert flags == once


@pytest.mark.parametrize("option", LOOPS)
def test_an_option_of_the_user_is_not_mixed_with_ours(option):
    flags = {"XLA_FLAGS": f"{option}=x"}
    prepare(flags)
    assert flags == {"XLA_FLAGS": f"{option}=x"}


def test_an_xla_that_is_not_known_gets_no_options(monkeypatch):
    """It would end the program at an option that it does not know."""
    monkeypatch.setattr(settings, "version", lambda _: "0.99.0")
    flags = {}
    prepare(flags)
    assert "XLA_FLAGS" not in flags
