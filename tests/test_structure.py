"""The house rules that a reader can count on: which way imports run, who may use what, docstrings."""

import ast
import graphlib
import importlib
import importlib.resources
import inspect
import types
from pathlib import Path

import pytest

import jaxmuscle

ROOT = Path(jaxmuscle.__file__).parent
ORDER = (
    "errors",
    "files",
    "units",
    "parameter_names",
    "parameters",
    "signals",
    "optimization",
    "components",
    "hysteresis",
    "effects",
    "actuators",
    "robot",
    "recordings",
    "simulation",
    "analysis",
    "animation",
    "control",
    "sweeps",
    "estimation",
    "tuning",
    "diagnosis",
    "report",
    "cli",
)
"""Each imports only from those before it, and from within itself."""
ON_THE_SIDE = {
    "samples": {"errors"},
    "_config": {"errors", "_compilation_cache"},
    "_compilation_cache": {"errors"},
    "_traced_programs": {"_compilation_cache", "errors", "files"},
    "_memory_areas": set(),
    "_linalg": set(),
    "formatting": {"parameter_names", "units"},
    "decimation": set(),
    "figure_style": {"decimation"},
    "html_template": {"formatting"},
    "notebook_html": {"decimation", "formatting", "html_template", "parameters"},
    "progress": set(),
    "parallel": {"_config"},
}
"""Data, settings and mathematics that any may import, and what they may import themselves."""
MINIMISER = {
    "jaxmuscle.optimization",
    "jaxmuscle.optimization.descents",
    "jaxmuscle.optimization.levenberg_marquardt",
    "jaxmuscle.optimization.least_squares",
}
"""Mathematics that knows nothing of machines."""
DOORS = {
    "diffrax": {"simulation/solvers.py"},
    "optimistix": {
        "analysis/operating_point.py",
        "optimization/gauss_newton.py",
        "optimization/optimistix_solver.py",
    },
}
"""Libraries that only these modules may import."""
FILES = sorted(path for path in ROOT.rglob("*.py"))
INNER = [path for path in FILES if path != ROOT / "__init__.py"]


def name_of(path):
    """Dotted module name of a file."""
    parts = path.relative_to(ROOT.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in FILES}


def imports(path):
    """Dotted names of everything a file imports, wherever in it; a module in preference to a name from it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            package = (
                name_of(path).split(".") if path.name == "__init__.py" else name_of(path).split(".")[:-1]
            )
            base = package[: len(package) + 1 - node.level] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            inner = {f"{module}.{alias.name}" for alias in node.names}
            found |= {name if name in MODULES or module == "jaxmuscle" else module for name in inner}
    return found


def relative(path):
    """A file as it is named in this test's messages."""
    return path.relative_to(ROOT).as_posix()


def part(module):
    """The first name below the package."""
    return module.split(".")[1]


@pytest.mark.parametrize("path", INNER, ids=relative)
def test_imports_run_one_way(path):
    here = part(name_of(path))
    allowed = ON_THE_SIDE.get(here)
    if allowed is None:
        assert here in ORDER, f"say in ORDER where {here!r} stands"
        allowed = {*ORDER[: ORDER.index(here)], *ON_THE_SIDE}
    own = [m for m in imports(path) if m.startswith("jaxmuscle.") and m != "jaxmuscle.__version__"]
    wrong = sorted(m for m in own if part(m) not in {*allowed, here})
    assert not wrong, f"{relative(path)} imports {wrong}"


def test_the_minimiser_knows_nothing_of_machines():
    for name in MINIMISER:
        own = {module for module in imports(MODULES[name]) if module.startswith("jaxmuscle.")}
        assert own <= {*MINIMISER, "jaxmuscle.errors"}, name


def cycle(graph):
    """The modules of one cycle of imports; nothing if there is none."""
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return []


def test_no_cycles():
    graph = {name: imports(path) & set(MODULES) for name, path in MODULES.items()}
    # The package itself imports when a name is asked for.
    del graph["jaxmuscle"]
    assert graph["jaxmuscle.recordings.card"] >= {"jaxmuscle.recordings.schema", "jaxmuscle.errors"}
    assert cycle(graph) == []
    # A module that something imports, by however many steps, must not import that.
    graph["jaxmuscle.errors"] |= {"jaxmuscle.recordings.card"}
    assert {"jaxmuscle.errors", "jaxmuscle.recordings.card"} <= set(cycle(graph))


@pytest.mark.parametrize("library", DOORS)
def test_only_the_doors_import(library):
    users = {relative(path) for path in FILES if any(m.split(".")[0] == library for m in imports(path))}
    assert users <= DOORS[library]
    if library == "diffrax":
        assert users == DOORS[library]


def is_method(cls, key):
    """Whether a name in the body of a class is a public method or property."""
    value = inspect.getattr_static(cls, key)
    kinds = types.FunctionType | property | classmethod | staticmethod
    return not key.startswith("_") and isinstance(value, kinds)


def public(path):
    """Names and objects defined in a module for others, with the methods of its classes."""
    module = importlib.import_module(name_of(path))
    for name, thing in vars(module).items():
        if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
            continue
        if inspect.isclass(thing):
            yield name, thing
            if getattr(thing, "_is_protocol", False):
                continue
            yield from (
                (f"{name}.{key}", getattr(thing, key)) for key in vars(thing) if is_method(thing, key)
            )
        elif inspect.isfunction(thing) or hasattr(thing, "__wrapped__"):
            yield name, thing


@pytest.mark.parametrize("path", FILES, ids=relative)
def test_every_public_name_has_a_docstring(path):
    module = importlib.import_module(name_of(path))
    assert inspect.getdoc(module)
    # Methods that fill in an abstract one inherit its docstring.
    missing = [name for name, thing in public(path) if not inspect.getdoc(thing)]
    assert not missing, f"{relative(path)}: {missing}"


def test_type_checkers_are_told_that_the_package_has_types():
    assert (importlib.resources.files(jaxmuscle) / "py.typed").is_file()
