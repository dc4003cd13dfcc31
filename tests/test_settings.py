"""What importing the package sets in JAX and XLA."""

import os
import subprocess
import sys

import pytest

from jaxmuscle.settings import EXTRA, LOOPS, prepare

LOOP = """
import {first}, {second}
import jax.numpy as jnp
loop = jax.jit(lambda x: jax.lax.scan(lambda c, _: (jnp.sin(c) + c[::-1], c), x, length=1000)[1])
print("xla_cpu_small_call" in loop.lower(jnp.ones(40)).compile().as_text(), jnp.ones(1).dtype)
"""


@pytest.mark.parametrize(("first", "second"), [("jax", "jaxmuscle"), ("jaxmuscle", "jax")])
@pytest.mark.parametrize(
    ("given", "whole"), [("", True), (f"{EXTRA}xla_cpu_small_while_loop_byte_threshold=0", False)]
)
def test_a_loop_is_compiled_as_a_whole_unless_the_user_says_otherwise(first, second, given, whole):
    environment = {**os.environ, "XLA_FLAGS": given, "JAX_ENABLE_COMPILATION_CACHE": "false"}
    program = LOOP.format(first=first, second=second)
    told = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == [str(whole), "float64"]


def test_other_flags_are_kept():
    flags = {"XLA_FLAGS": "--xla_cpu_enable_fast_math=false"}
    prepare(flags)
    assert flags["XLA_FLAGS"].split() == ["--xla_cpu_enable_fast_math=false", *LOOPS]
    prepare(flags)
    assert flags["XLA_FLAGS"].count(EXTRA) == 1
