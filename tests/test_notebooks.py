"""The notebooks run from top to bottom and show what the package gives now."""

import importlib.util
import re
from pathlib import Path

import nbformat
import pytest

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(path.name for path in FOLDER.glob("*.ipynb"))
NUMBER = re.compile(r"-?\d+\.?\d*(?:e[+-]?\d+)?")


def executor():
    """The script that executes notebooks, as a module."""
    spec = importlib.util.spec_from_file_location("execute", FOLDER / "execute.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def printed(notebook):
    """What the cells printed, joined."""
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    return "".join(out.text for out in outputs if out.output_type == "stream" and out.name == "stdout")


def figures(notebook):
    return sum(
        "image/png" in out.get("data", {}) for cell in notebook.cells for out in cell.get("outputs", [])
    )


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebook_is_stored_with_its_outputs(name):
    notebook = nbformat.read(FOLDER / name, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    assert figures(notebook) >= 3
    kinds = {out.output_type for cell in code for out in cell.outputs}
    assert "error" not in kinds
    assert not any(out.get("name") == "stderr" for cell in code for out in cell.outputs)
    # Where it was run is nobody's business: the package is somewhere else for its readers.
    assert not re.search(r"(Posix|Windows)Path\(['\"]/", (FOLDER / name).read_text(encoding="utf-8"))


@pytest.mark.thorough
@pytest.mark.usefixtures("kept_programs")
@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebook_runs_and_gives_what_is_stored(name):
    stored = nbformat.read(FOLDER / name, as_version=4)
    fresh = executor().executed(FOLDER / name)
    assert figures(fresh) == figures(stored)
    ours, theirs = printed(fresh), printed(stored)
    assert NUMBER.sub("#", ours) == NUMBER.sub("#", theirs)
    pairs = zip(NUMBER.findall(ours), NUMBER.findall(theirs), strict=True)
    # The last digits that are printed may differ between machines; rounding errors may do so entirely.
    for a, b in ((float(x), float(y)) for x, y in pairs):
        assert a == pytest.approx(b, rel=0.05, abs=1e-9)
