"""Rigs and effects of the user's own, from a Python file."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from jaxmuscle.actuators import RIGS
from jaxmuscle.cli import app
from jaxmuscle.cli.own_modules import PREFIX, load_modules
from jaxmuscle.effects import BY_NAME
from jaxmuscle.errors import InputError
from jaxmuscle.samples import sample

EFFECT = """
from typing import ClassVar

import jaxmuscle as jm
from jaxmuscle.effects import AbstractStaticEffect
from jaxmuscle.parameters import Scalar, parameter
from jaxmuscle.signals import LOAD


@jm.effects.register
class Brush(AbstractStaticEffect):
    r"\""A brush that pushes with a constant force.\"""

    name: ClassVar = "brush"
    slot: ClassVar = LOAD
    reads: ClassVar = frozenset({"velocity"})
    strength: ClassVar = "force"
    starts: ClassVar = ({},)
    source: ClassVar = "the test"

    force: Scalar = parameter("{load}", "force of the brush", default=0.0)

    def value(self, signals):
        return self.force + 0 * signals.velocity
"""
RIG = """
import jaxmuscle as jm
from jaxmuscle.actuators import Isotonic


@jm.actuators.register
class Hoist(Isotonic):
    "\""A lift under a name of its own."\""

    rig = "NAME"
"""


@pytest.fixture(autouse=True)
def _registers_as_before() -> Iterator[None]:
    registers: list[dict[str, Any]] = [RIGS, BY_NAME]
    before = [dict(register) for register in registers]
    yield
    for register, names in zip(registers, before, strict=True):
        register.clear()
        register.update(names)
    for name in [name for name in sys.modules if name.startswith(PREFIX)]:
        del sys.modules[name]


def written(folder: Path, text: str) -> Path:
    """A file of the user's."""
    file = folder / "my_rig.py"
    file.write_text(text, encoding="utf-8")
    return file


def test_effects_of_a_file_are_registered_and_returned(tmp_path: Path) -> None:
    (effect,) = load_modules([written(tmp_path, EFFECT)])
    assert effect is BY_NAME["brush"]
    again = load_modules([tmp_path / "my_rig.py"])
    assert [each.name for each in again] == ["brush"], "the same file may be loaded once more"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x = 1\n", "registers no rig and no effect"),
        ("a = 1\nb = a / 0\n", "raises ZeroDivisionError in line 2: division by zero"),
        ("def f(:\n", "raises SyntaxError in line 1"),
        ("import no_such_module_here\n", "raises ModuleNotFoundError in line 1"),
        ("raise SystemExit(3)\n", "raises SystemExit in line 1"),
        (RIG.replace("NAME", "joint"), "the name 'joint' is that of Joint"),
        (EFFECT.replace('"brush"', '"creep"'), "the name 'creep' is that of Creep"),
    ],
)
def test_files_that_are_no_use_are_told(tmp_path: Path, text: str, told: str) -> None:
    rigs, effects, path = dict(RIGS), dict(BY_NAME), list(sys.path)
    with pytest.raises(InputError, match="my_rig.py") as error:
        load_modules([written(tmp_path, text)])
    assert told in str(error.value)
    assert (dict(RIGS), dict(BY_NAME), sys.path) == (rigs, effects, path)


def test_no_file(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no module"):
        load_modules([tmp_path / "absent.py"])


def test_a_card_of_an_own_rig_with_an_own_effect_is_checked(tmp_path: Path) -> None:
    card = sample("lift").with_suffix(".toml").read_text(encoding="utf-8")
    card = (
        card.replace('rig = "isotonic"', 'rig = "hoist"')
        + "\n[effects.brush]\nforce = { value = 1, unit = 'N' }\n"
    )
    (tmp_path / "lift.toml").write_text(card, encoding="utf-8")
    (tmp_path / "lift.csv").write_bytes(sample("lift").read_bytes())
    file = written(tmp_path, RIG.replace("NAME", "hoist") + EFFECT)
    asked = ["check", str(tmp_path / "lift.toml")]
    without = CliRunner().invoke(app, asked)
    assert without.exit_code == 2 and "unknown rig 'hoist'" in without.stderr
    outcome = CliRunner().invoke(app, [*asked, "--module", str(file)])
    assert outcome.exit_code == 0, outcome.stderr
    assert "effect brush" in outcome.stdout


def test_effects_lists_own_ones(tmp_path: Path) -> None:
    outcome = CliRunner().invoke(app, ["effects", "--module", str(written(tmp_path, EFFECT))])
    assert outcome.exit_code == 0
    assert "Your own:" in outcome.stdout and outcome.stdout.split("Your own:")[1].split()[5] == "brush"


@pytest.mark.parametrize(
    "command", ["diagnose", "init", "check", "compare", "fit", "simulate", "sweep", "tune"]
)
def test_every_command_that_reads_a_card_takes_a_module(command: str) -> None:
    assert "--module" in CliRunner().invoke(app, [command, "--help"]).stdout
