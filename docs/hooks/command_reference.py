"""Reference of the command line, from the functions that typer makes the program of."""

from __future__ import annotations

import inspect
import types
import typing
from collections.abc import Callable
from typing import Any

from tables import code, table
from typer.models import ArgumentInfo, OptionInfo

from jaxmuscle.cli import app

ENDS = (
    ("0", "done"),
    ("1", "a fault of the program"),
    ("2", "the input cannot be used; one message says what was expected, what came and what to do"),
    ("130", "ended by Ctrl-C"),
)


def command_reference() -> str:
    """The page."""
    commands = {each.callback.__name__: each.callback for each in app.registered_commands if each.callback}
    rows = [(f"[`jaxmuscle {name}`](#{name})", _first(each.__doc__)) for name, each in commands.items()]
    parts = [
        "# Command line\n",
        f"{app.info.help} Generated from the program; `jaxmuscle COMMAND --help` prints the same.\n",
        table(("command", "what it does"), rows),
        "Results go to standard output, progress and messages to standard error. Exit statuses:\n",
        table(("status", "meaning"), [(code(number), said) for number, said in ENDS]),
    ]
    return "\n".join([*parts, *(_command(name, each) for name, each in commands.items())])


def _first(text: str | None) -> str:
    return (text or "").strip().split("\n\n")[0].replace("\n", " ")


def _command(name: str, function: Callable[..., Any]) -> str:
    hints = typing.get_type_hints(function, include_extras=True)
    arguments, options = [], []
    for parameter in inspect.signature(function).parameters.values():
        kind, told = typing.get_args(hints[parameter.name])
        if isinstance(told, ArgumentInfo):
            arguments.append((_shown_argument(parameter, kind), _escaped(told.help)))
        elif isinstance(told, OptionInfo):
            options.append((_shown_option(parameter, kind, told), _default(parameter), _escaped(told.help)))
    usage = " ".join(
        ["jaxmuscle", name, *(["[OPTIONS]"] if options else []), *(shown for shown, _ in arguments)]
    )
    parts = [
        f"## `jaxmuscle {name}` {{ #{name} }}\n",
        f"{inspect.getdoc(function)}\n",
        f"```text\n{usage}\n```\n",
    ]
    if arguments:
        parts.append(table(("argument", "what"), [(code(shown), said) for shown, said in arguments]))
    if options:
        parts.append(table(("option", "when not given", "what"), options))
    return "\n".join(parts)


def _escaped(text: str | None) -> str:
    """A text with brackets that are no link."""
    return (text or "").replace("[", "\\[")


def _shown_argument(parameter: inspect.Parameter, kind: Any) -> str:
    name = parameter.name.upper() + ("..." if typing.get_origin(kind) is list else "")
    return name if parameter.default is inspect.Parameter.empty else f"[{name}]"


def _shown_option(parameter: inspect.Parameter, kind: Any, told: OptionInfo) -> str:
    # Within Annotated the first name that an option is given stands where its default would.
    given = [each for each in (told.default, *(told.param_decls or ())) if str(each).startswith("--")]
    name = given[0] if given else f"--{parameter.name.replace('_', '-')}"
    if kind is bool:
        return code(name if given else f"{name} / --no-{name.removeprefix('--')}")
    return code(f"{name} {_word(kind)}")


def _word(kind: Any) -> str:
    """What stands for the value of an option: TEXT, NUMBER, PATH."""
    if isinstance(kind, types.UnionType) or typing.get_origin(kind) is list:
        return _word(next(each for each in typing.get_args(kind) if each is not types.NoneType))
    return {"str": "TEXT", "int": "INTEGER", "float": "NUMBER", "Path": "PATH"}[kind.__name__]


def _default(parameter: inspect.Parameter) -> str:
    if parameter.default is inspect.Parameter.empty:
        return "has to be given"
    if isinstance(parameter.default, bool):
        return "on" if parameter.default else "off"
    return "" if parameter.default is None else code(str(parameter.default))
