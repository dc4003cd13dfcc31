"""Reference of Python: a page for each public package, of the names that its ``__all__`` lists."""

from __future__ import annotations

import importlib
import inspect
import types

import jaxmuscle


def python_reference() -> dict[str, tuple[str, str]]:
    """File → (title, page)."""
    pages = {"jaxmuscle.md": ("jaxmuscle", _front())}
    for name in jaxmuscle.__all__:
        thing = getattr(jaxmuscle, name)
        if _is_module(name):
            pages[f"{name}.md"] = (f"jaxmuscle.{name}", _package(f"jaxmuscle.{name}", thing))
    return pages


def _front() -> str:
    named, packages = [], []
    for name in jaxmuscle.__all__:
        (packages if _is_module(name) else named).append(name)
    links = ", ".join(f"[`jm.{name}`]({name}.md)" for name in packages)
    entries = [_entry(_place("jaxmuscle", name), f"jm.{name}") for name in named]
    return "\n".join(
        ["# jaxmuscle\n", "What `import jaxmuscle as jm` offers.\n", f"Packages: {links}.\n", *entries]
    )


def _package(title: str, package: types.ModuleType) -> str:
    name = package.__name__
    listed = [each for each in getattr(package, "__all__", ()) if _is_documented(package, each)]
    if not hasattr(package, "__all__"):
        listed = [
            each for each, thing in vars(package).items()
            if not each.startswith("_") and getattr(thing, "__module__", None) == name
        ]  # fmt: skip
    # What the front page tells has one place.
    front = {_place("jaxmuscle", each): each for each in jaxmuscle.__all__ if not _is_module(each)}
    told = [front[place] for each in listed if (place := _place(name, each)) in front]
    also = ", ".join(f"[`jm.{each}`](jaxmuscle.md#{_place('jaxmuscle', each)})" for each in told)
    entries = [
        _entry(place, f"{title.replace('jaxmuscle', 'jm', 1)}.{each}")
        for each in listed
        if (place := _place(name, each)) not in front
    ]
    return "\n".join(
        [f"# {title}\n", f"{_about(package)}\n", *([f"Also {also}.\n"] if also else []), *entries]
    )


def _is_module(name: str) -> bool:
    return isinstance(getattr(jaxmuscle, name), types.ModuleType)


def _about(package: types.ModuleType) -> str:
    from docstring_markup import as_markdown

    return as_markdown(inspect.cleandoc(package.__doc__ or ""))


def _is_documented(package: types.ModuleType, name: str) -> bool:
    thing = getattr(package, name)
    return inspect.isclass(thing) or inspect.isfunction(thing) or hasattr(thing, "__wrapped__")


def _place(package: str, name: str) -> str:
    """Where a name is defined: there its docstring is found without running anything."""
    thing = getattr(importlib.import_module(package), name)
    return f"{thing.__module__}.{getattr(thing, '__qualname__', name)}"


def _entry(place: str, title: str) -> str:
    options = {"heading": title, "toc_label": title.rpartition(".")[2]}
    lines = "\n".join(f'      {name}: "{value}"' for name, value in options.items())
    return f"::: {place}\n    options:\n{lines}\n"
