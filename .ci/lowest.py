"""Print the declared lower bounds of the package as constraints for pip: name==version, a line each."""

import re
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parent.parent / "pyproject.toml").read_text(encoding="utf-8"))[
    "project"
]
extras = project["optional-dependencies"]
wanted = [*project["dependencies"], *extras["distributed"], *extras["test"], *extras["docs"]]
for requirement in wanted:
    name, bound = re.match(r"([\w.-]+)(?:\[.*\])?(?:>=([\w.]+))?", requirement).groups()
    if bound:
        print(f"{name}=={bound}")
    elif name != project["name"]:
        raise SystemExit(f"{requirement}: expected a lower bound, name>=version")
