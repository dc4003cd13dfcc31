"""Python files of the user's with rigs and effects of their own (option ``--module``)."""

from __future__ import annotations

import importlib.util
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from jaxmuscle.errors import InputError
from jaxmuscle.files import existing_file

if TYPE_CHECKING:
    from jaxmuscle.effects.base import AbstractEffect

PREFIX = "jaxmuscle_module_"
"""What the name of such a file begins with as a module, so that it hides none of another."""


def load_modules(files: Sequence[Path] | None) -> list[type[AbstractEffect]]:
    """Run `files`, which register rigs and effects; returns the effects, in the order of registration.

    Raises:
        InputError: no such file, one that raises, or one that registers nothing.
    """
    found: list[type[AbstractEffect]] = []
    for file in files or ():
        found += _loaded(existing_file(file, "module", (".py",)))
    return found


def _loaded(file: Path) -> list[type[AbstractEffect]]:
    """The effects that a file registers."""
    import jaxmuscle.robot  # noqa: F401 - its rig joins the registry
    from jaxmuscle.actuators import RIGS
    from jaxmuscle.effects import BY_NAME

    rigs, effects = dict(RIGS), dict(BY_NAME)
    try:
        _run(file)
    except InputError as error:
        _restore(RIGS, rigs)
        _restore(BY_NAME, effects)
        raise InputError(f"{file}: {error}") from error
    own = [effect for name, effect in BY_NAME.items() if effects.get(name) is not effect]
    if not own and all(rigs.get(name) is rig for name, rig in RIGS.items()):
        raise InputError(
            f"{file}: registers no rig and no effect; expected a class under "
            f"@jaxmuscle.actuators.register or @jaxmuscle.effects.register"
        )
    return own


def _restore(register: dict, before: dict) -> None:
    register.clear()
    register.update(before)


def _run(file: Path) -> None:
    """Import a file as a module of its own name; what goes wrong in it is the user's to mend."""
    name = PREFIX + file.stem
    spec = importlib.util.spec_from_file_location(name, file.absolute())
    if spec is None or spec.loader is None:
        raise InputError("cannot be imported as a Python module")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    # A module finds others that lie beside it, as a program does.
    folder = str(file.resolve().parent)
    sys.path.insert(0, folder)
    try:
        spec.loader.exec_module(module)
    except InputError:
        raise
    except (Exception, SystemExit) as error:
        lines = [
            frame.lineno
            for frame in traceback.extract_tb(error.__traceback__)
            if frame.filename == str(file.absolute())
        ]
        number = error.lineno if isinstance(error, SyntaxError) else lines[-1] if lines else None
        where = "" if number is None else f" in line {number}"
        raise InputError(
            f"raises {type(error).__name__}{where}: {error}; mend it (python {file} shows the same, with its "
            f"traceback)"
        ) from error
    finally:
        sys.path.remove(folder)
    if importlib.util.find_spec("cloudpickle") is not None:
        import cloudpickle

        # Workers of a cluster have no such module: its classes travel with what is computed.
        cloudpickle.register_pickle_by_value(module)
