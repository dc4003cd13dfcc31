"""Every name that the documentation uses is there without anything being imported before."""

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import jaxmuscle

ROOT = Path(__file__).parents[1]
NAME = re.compile(r"\bjm((?:\.[A-Za-z_]\w*)+)")
BACKTICKED = re.compile(r"`jaxmuscle((?:\.[A-Za-z_]\w*)+)`")
LOAD_EACH = """
import importlib, json, sys
wrong = {}
for first, names in json.loads(sys.argv[1]).items():
    for module in [m for m in sys.modules if m.split(".")[0] == "jaxmuscle"]:
        del sys.modules[module]
    package = importlib.import_module("jaxmuscle")
    for name in [first, *names]:
        try:
            thing = package
            for part in name.split("."):
                thing = getattr(thing, part)
        except AttributeError as error:
            wrong[name] = str(error)
print(json.dumps(wrong))
"""


def sources_of(notebook):
    """The text of all cells."""
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells)


def documented():
    """Dotted names below the package in the README, the pages of docs and the notebooks."""
    pages = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md"))
    texts = [page.read_text(encoding="utf-8") for page in pages]
    texts += [sources_of(file) for file in (ROOT / "notebooks").glob("*.ipynb")]
    found = {name for text in texts for name in [*NAME.findall(text), *BACKTICKED.findall(text)]}
    return sorted(name.removeprefix(".") for name in found)


@pytest.mark.slow
def test_documented_names_load_in_a_fresh_process():
    names = documented()
    assert {"analysis", "hysteresis", "fit", "robot.robot_joint"} <= set(names) and len(names) > 25
    firsts = sorted({*(name.partition(".")[0] for name in names), *jaxmuscle.__all__})
    groups = {first: [name for name in names if name.startswith(f"{first}.")] for first in firsts}
    done = subprocess.run(
        [sys.executable, "-c", LOAD_EACH, json.dumps(groups)],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    assert json.loads(done.stdout) == {}


def test_what_type_checkers_see_is_what_loads():
    tree = ast.parse((ROOT / "jaxmuscle" / "__init__.py").read_text(encoding="utf-8"))
    guarded = [node for node in tree.body if isinstance(node, ast.If)]
    imports = [each for node in guarded for each in node.body if isinstance(each, ast.ImportFrom)]
    seen = {alias.asname or alias.name for each in imports for alias in each.names}
    assert seen | {"commands"} == set(jaxmuscle.__all__) == set(jaxmuscle._PLACES)
