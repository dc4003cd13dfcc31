"""What all tests share."""

import importlib
import os
import signal
from pathlib import Path
from zlib import crc32

import jax
import psutil
import pytest
from jaxtyping import install_import_hook

CHECKED = ("analysis", "components", "hysteresis", "recordings", "report", "signals", "sweeps")
# Before anything imports them: what their annotations say of arrays holds at every call in a test. That takes
# an eighth of the time of a test that calls components one by one.
if os.environ.get("JAXMUSCLE_ANNOTATIONS") != "unchecked":
    install_import_hook([f"jaxmuscle.{part}" for part in CHECKED], "array_annotations.check")
MEMORY = 2e9
"""That a worker may hold at the end of a file before it forgets what it has compiled [bytes]."""


def _share_cores() -> None:
    """Confine a worker to cores of its own, and the processes that it starts.

    Two workers that both divide their fits among the same two cores take a sixth longer for them.
    """
    name, workers = os.environ.get("PYTEST_XDIST_WORKER"), int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", 1))
    if name is None or not hasattr(os, "sched_setaffinity"):
        return
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) >= workers:
        os.sched_setaffinity(0, cores[int(name.removeprefix("gw")) % workers :: workers])


# Before anything asks how many there are.
_share_cores()


def pytest_configure(config: pytest.Config) -> None:
    """No test finds programs that an earlier run has compiled, unless a folder for them was asked for."""
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        os.environ.setdefault("JAX_ENABLE_COMPILATION_CACHE", "false")
        jax.config.update("jax_enable_compilation_cache", False)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Thorough tests are those of the share that is asked for, if one is: "2/4" has two quarters before it.

    Files with tests that take long come first: a long one at the end leaves all workers but one idle.
    """
    number, _, shares = os.environ.get("JAXMUSCLE_THOROUGH", "0/1").partition("/")

    def is_of_another_share(item: pytest.Item) -> bool:
        share = crc32(item.nodeid.encode()) % int(shares)
        return item.get_closest_marker("thorough") is not None and share != int(number)

    config.hook.pytest_deselected(items=[item for item in items if is_of_another_share(item)])
    items[:] = [item for item in items if not is_of_another_share(item)]
    long = {item.path for item in items if any(item.get_closest_marker(m) for m in ("slow", "thorough"))}
    items.sort(key=lambda item: item.path not in long)


@pytest.fixture
def shared() -> Path:
    """The folder beside the repository with recordings that are not part of it."""
    folder = Path(__file__).parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip(f"there is no {folder}: its recordings do not come with the repository")
    return folder


@pytest.fixture
def package_rigs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the rigs of the package are registered, as in a new process: other tests bring their own."""
    import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
    from jaxmuscle.actuators import RIGS

    for name in [name for name, rig in RIGS.items() if not rig.__module__.startswith("jaxmuscle.")]:
        monkeypatch.delitem(RIGS, name)


@pytest.fixture
def sized_muscles(monkeypatch: pytest.MonkeyPatch):
    """The rig of the benchmarks for muscles of several lengths, which is registered for one test."""
    from jaxmuscle.actuators import RIGS

    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "benchmarks")
    rig = importlib.import_module("sized_muscles").SizedMuscles
    RIGS[rig.rig] = rig  # also where another test has loaded the module before
    yield rig
    del RIGS[rig.rig]


@pytest.fixture
def kept_programs(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes that a test starts find what others of this run of the tests have compiled."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # that of all workers
    monkeypatch.setenv("JAX_ENABLE_COMPILATION_CACHE", "true")
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(folder / "programs"))
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")


@pytest.fixture(autouse=True, scope="module")
def _forget_compiled():
    """Small compiled programs serve the next file, too; all that there are would take tens of gigabytes."""
    yield
    if psutil.Process().memory_info().rss > MEMORY:
        jax.clear_caches()


@pytest.fixture
def interrupts():
    """Ctrl-C as in a terminal: programs in the background ignore it, and so do their child processes."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
