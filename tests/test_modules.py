"""Modules are named once, and loading all of them leaves every public name what it was."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import jaxmuscle

ROOT = Path(jaxmuscle.__file__).parent
LOAD_ALL = """
import importlib, json, pkgutil, types
import jaxmuscle

def names():
    found = {name: getattr(jaxmuscle, name) for name in jaxmuscle.__all__}
    for package, thing in list(found.items()):
        if isinstance(thing, types.ModuleType):
            inner = {f"{package}.{name}": getattr(thing, name) for name in getattr(thing, "__all__", ())}
            found.update(inner)
    return found

before = names()
for module in pkgutil.walk_packages(jaxmuscle.__path__, "jaxmuscle."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
after = names()
changed = [name for name in before if after[name] is not before[name]]
functions = "actuator diagnose fit read recording simulate sweep tune".split()
callables = [name for name in before if name in functions]
shadowed = [name for name in callables if not callable(after[name])]
print(json.dumps([len(before), len(callables), changed, shadowed]))
"""


@pytest.mark.slow
def test_loading_every_module_hides_no_public_name():
    done = subprocess.run(
        [sys.executable, "-c", LOAD_ALL], capture_output=True, text=True, check=True, cwd=ROOT.parent
    )
    number, callables, changed, shadowed = json.loads(done.stdout)
    assert number > 100 and callables == 8
    assert (changed, shadowed) == ([], [])


def test_no_file_name_occurs_twice():
    count = Counter(path.name for path in ROOT.rglob("*.py") if path.name != "__init__.py")
    assert [name for name, times in count.items() if times > 1] == []
