"""Compiled programs that are kept for the next process: found again, and never an obstacle."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from jaxmuscle import _compilation_cache
from jaxmuscle._compilation_cache import ENTRY, TRACE
from jaxmuscle._config import needed
from jaxmuscle.errors import InputError

CLEAN = {name: value for name, value in os.environ.items() if "COMPILATION_CACHE" not in name}
"""The environment of a process in which nobody has said anything about compiled programs."""
SWITCH = "jm.configure(compile_cache=True)"
SIMULATION = """
machine = jm.actuator(jm.read(jm.sample("lift")).card)
clock = 0.002 * np.arange(200)
result = jm.simulate(machine, 3.0 * (clock > 0.05), clock).readings["position"][-1]
"""
DIAGNOSIS = """
import os
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, range(os.cpu_count()))  # a worker of the tests has few
warnings.simplefilter("default")
some = (jm.effects.ChamberLeak, jm.effects.Creep, jm.effects.LoadFriction)
found = jm.diagnose(jm.read(jm.sample("lift")), catalogue=some, constants=False)
result = sum(estimate.value for estimate in found.parameters.values())
"""
SUM = "result = jax.jit(lambda x: (x * x).sum())(np.ones(9))"
PROGRAM = """
import json, warnings, jaxmuscle as jm, jax, numpy as np
warnings.simplefilter("error")
events = {}
def count(event, **_):
    events[event.rpartition("/")[2]] = events.get(event.rpartition("/")[2], 0) + 1
jax.monitoring.register_event_listener(count)
SWITCH
COMPUTE
print(json.dumps({
    "result": float(result).hex(), "hits": events.get("cache_hits", 0),
    "kept": events.get("cache_misses", 0), "asked": events.get("compile_requests_use_cache", 0),
    "folder": str(jm.configure().compile_cache),
}))
"""


def computed(cache: Path, switch: str = SWITCH, compute: str = SUM, **environment: str) -> dict:
    """What a process of its own tells of its result, its compilations and those that it found."""
    home = {"XDG_CACHE_HOME": str(cache), "LOCALAPPDATA": str(cache), "HOME": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.replace("SWITCH", switch).replace("COMPUTE", compute)],
        env={**CLEAN, **home, **environment}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    # Nor what jaxlib 0.10 has to say of every program that it finds ("Loading XLA:CPU AOT result …").
    assert not re.search("cache|AOT", done.stderr), done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> tuple[Path, dict]:
    """A cache folder after the first process, and what that told."""
    cache = tmp_path_factory.mktemp("cache")
    return cache, computed(cache, compute=SIMULATION)


def entries(folder: Path) -> list[Path]:
    return sorted(folder.rglob(f"*{ENTRY}"))


def test_a_second_process_compiles_nothing(filled):
    cache, first = filled
    assert first["kept"] > 0 and entries(cache)
    second = computed(cache, compute=SIMULATION)
    # With the options that jaxlib 0.10 needs a program with several places for its results is not kept.
    unkept = 3 if needed() else 0
    assert second["kept"] == 0 and second["asked"] - second["hits"] <= unkept
    assert second["result"] == first["result"]


@pytest.mark.slow
def test_broken_entries_are_compiled_anew(filled):
    cache, first = filled
    for number, entry in enumerate(entries(cache)):
        whole = entry.read_bytes()
        spoilt = (b"", whole[: len(whole) // 2], whole[:-40] + bytes(40), b"no program")
        entry.write_bytes(spoilt[number % len(spoilt)])
    again = computed(cache, compute=SIMULATION)
    assert again["hits"] == 0 and again["result"] == first["result"]


@pytest.mark.slow
def test_processes_may_write_at_once(tmp_path):
    environment = {**CLEAN, "XDG_CACHE_HOME": str(tmp_path), "LOCALAPPDATA": str(tmp_path),
                   "HOME": str(tmp_path)}  # fmt: skip
    command = [sys.executable, "-c", PROGRAM.replace("SWITCH", SWITCH).replace("COMPUTE", SUM)]
    both = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    told = [json.loads(process.communicate()[0]) for process in both]
    assert told[0]["result"] == told[1]["result"] == computed(tmp_path)["result"]


@pytest.mark.parametrize("switch", ["", SWITCH + "\njm.configure(compile_cache=False)"])
def test_nothing_is_kept_unless_asked_for(tmp_path, switch):
    told = computed(tmp_path, switch)
    assert told["folder"] == "None" and told["kept"] == 0 and not entries(tmp_path)


def test_a_folder_that_cannot_be_made_is_no_obstacle(tmp_path):
    (tmp_path / "file").write_text("no folder")
    told = computed(tmp_path / "file")
    assert told["folder"] == "None" and told["kept"] == 0


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write anywhere"
)
def test_a_folder_that_cannot_be_written_is_no_obstacle(tmp_path):
    folder = tmp_path / "jaxmuscle" / "programs"
    folder.mkdir(parents=True)
    folder.chmod(0o500)
    assert computed(tmp_path)["folder"] == "None"


@pytest.mark.slow
def test_a_folder_that_disappears_is_no_obstacle(tmp_path):
    gone = "import shutil; shutil.rmtree(jm.configure().compile_cache)"
    told = computed(tmp_path, f"{SWITCH}; {gone}; open(jm.configure().compile_cache, 'x').close()")
    assert told["hits"] == 0 and told["result"] == computed(tmp_path / "whole")["result"]


def test_a_folder_of_ones_own(tmp_path):
    own = tmp_path / "own"
    told = computed(tmp_path / "other", f"jm.configure(compile_cache={str(own)!r})")
    assert told["folder"] == str(own) and entries(own) and not entries(tmp_path / "other")


def test_a_folder_of_ones_own_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("no folder")
    jax = SimpleNamespace(
        config=SimpleNamespace(jax_enable_compilation_cache=True, jax_compilation_cache_dir=None)
    )
    with pytest.raises(InputError, match="expected a folder that can be written"):
        _compilation_cache.switch_on(jax, tmp_path / "file" / "programs")


@pytest.mark.parametrize("switch", [SWITCH, SWITCH + "\njm.configure(compile_cache=False)"])
def test_what_the_user_has_chosen_stays(tmp_path, switch):
    chosen = tmp_path / "chosen"
    told = computed(tmp_path / "ours", switch, JAX_COMPILATION_CACHE_DIR=str(chosen))
    assert told["folder"] == str(chosen) and not entries(tmp_path / "ours")


def test_a_user_who_forbids_it_is_obeyed(tmp_path):
    told = computed(tmp_path, JAX_ENABLE_COMPILATION_CACHE="false")
    assert told["folder"] == "None" and not entries(tmp_path)


@pytest.mark.slow
def test_programs_of_another_cpu_have_other_names():
    """JAX names a program by this number, among others."""
    program = (
        "import jax\nfrom jax._src.lib import xla_client\n"
        "print(xla_client.get_topology_for_devices(jax.devices()).fingerprint())"
    )

    def fingerprint(flags: str) -> str:
        done = subprocess.run(
            [sys.executable, "-c", program],
            env={**CLEAN, "XLA_FLAGS": flags}, capture_output=True, text=True, check=True,
        )  # fmt: skip
        return done.stdout

    assert fingerprint("") == fingerprint("") != fingerprint("--xla_cpu_max_isa=SSE4_2")


def test_the_oldest_programs_go_when_the_folder_is_full(tmp_path):
    for age in range(5):
        entry = tmp_path / f"jit_{age}{ENTRY}"
        entry.write_bytes(bytes(1000))
        os.utime(entry, (1e9 - age, 1e9 - age))
    (tmp_path / "else").write_bytes(bytes(10_000))
    _compilation_cache._shorten(tmp_path, 3500)
    assert [entry.name for entry in entries(tmp_path)] == [f"jit_{age}{ENTRY}" for age in range(3)]
    assert (tmp_path / "else").exists()


@pytest.mark.slow
def test_a_second_diagnosis_compiles_nothing(tmp_path):
    """Whatever threads compile side by side, in whatever order; nor does it trace what the first has."""

    def traced():
        return {file.name: file.stat().st_mtime_ns for file in tmp_path.rglob(f"*{TRACE}")}

    first = computed(tmp_path, compute=DIAGNOSIS)
    kept = traced()
    second = computed(tmp_path, compute=DIAGNOSIS)
    assert first["kept"] > 20 and second["kept"] == 0
    assert len(kept) >= 7 and traced() == kept
    assert second["result"] == first["result"]
    if not needed():
        assert second["hits"] == second["asked"]
