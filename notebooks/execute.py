"""Execute notebooks in place, so that they show what the package gives now.

`python notebooks/execute.py [NAME …]`
"""

from __future__ import annotations

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).parent


def executed(path: Path) -> nbformat.NotebookNode:
    """The notebook with the outputs of a fresh run; a cell that fails raises `CellExecutionError`."""
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": FOLDER}}
    ).execute()
    for cell in notebook.cells:
        cell.metadata.pop("execution", None)  # times of day
    notebook.metadata.get("language_info", {}).pop("version", None)
    return notebook


def main() -> int:
    """Execute the named notebooks, or all."""
    names = [Path(name).stem for name in sys.argv[1:]]
    for path in sorted(FOLDER.glob("*.ipynb")):
        if not names or path.stem in names:
            nbformat.write(executed(path), path)
            print(path.name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
