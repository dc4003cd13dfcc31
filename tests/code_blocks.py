"""Code blocks of Markdown pages, run as a reader runs them, each page in a folder and a process of its own.

A block of ``python`` or ``bash`` runs after those before it; one with ``title="FILE"`` is written as that
file instead. A block of ``text`` right below is what it prints. `python tests/code_blocks.py PAGE …` runs
pages and writes what their blocks print, and the pictures that they draw, into them.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^```(?P<language>\w+)(?P<attributes>[^\n]*)\n(?P<body>.*?)^```$", re.M | re.S)
TITLE = re.compile(r'title="([^"]+)"')
PICTURE = re.compile(r"!\[[^]]*\]\(([\w/.-]+\.(?:png|svg|gif))\)")
RUN = ("python", "bash")
ELSEWHERE = re.compile(r"python -m (pip install|pytest|mkdocs)\b|pre-commit |git ")
"""Commands that the continuous integration runs by itself (.ci/run, .github/workflows)."""
TIMEOUT = 1800.0


@dataclasses.dataclass(frozen=True)
class Block:
    """A fenced block: its language, the file that it is to be written to, its text and where that stands."""

    language: str
    file: str | None
    body: str
    begin: int
    end: int

    @property
    def runs(self) -> bool:
        """Whether it is a program."""
        return self.language in RUN and self.file is None


def blocks_of(text: str) -> list[Block]:
    """All fenced blocks of a page that name a language."""
    return [
        Block(
            found["language"],
            title[1] if (title := TITLE.search(found["attributes"])) else None,
            found["body"],
            found.start("body"),
            found.end("body"),
        )
        for found in BLOCK.finditer(text)
    ]


def printed_below(text: str) -> dict[int, Block]:
    """Number of a block that runs → the block right below it that holds what it prints."""
    blocks = blocks_of(text)
    return {
        number: below
        for number, (block, below) in enumerate(zip(blocks, blocks[1:], strict=False))
        if block.runs
        and below.language == "text"
        and not text[block.end + 3 : below.begin].partition("```")[0].strip()
    }


def run_page(page: Path, folder: Path) -> dict[int, str]:
    """Number of each block that runs → what it prints, from a fresh process that works in `folder`.

    Raises:
        AssertionError: a block failed; with its traceback.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "JAX_PLATFORMS": "cpu"}
    command = [sys.executable, str(Path(__file__).resolve()), "--inside", str(page.resolve())]
    result = folder / ".printed.json"
    with subprocess.Popen(
        [*command, str(result)],
        cwd=folder,
        env=environment,
        text=True,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    ) as process:
        try:
            _, said = process.communicate(timeout=TIMEOUT)
        finally:
            # What a page left running in the background ends with it.
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 0, f"{page.name}:\n{said}"
    return {int(number): text for number, text in json.loads(result.read_text(encoding="utf-8")).items()}


def _run_inside(page: Path, result: Path) -> None:
    """Run all blocks of a page in this process and the present folder."""
    programs = result.parent / ".programs"
    programs.mkdir()
    for name, command in {"jaxmuscle": "-m jaxmuscle.cli", "python": ""}.items():
        (programs / name).write_text(f'#!/bin/sh\nexec "{sys.executable}" {command} "$@"\n', encoding="utf-8")
        (programs / name).chmod(0o755)
    beside = Path(sys.executable).parent
    os.environ["PATH"] = os.pathsep.join([str(programs), str(beside), os.environ["PATH"]])
    names, printed = {"__name__": "__main__"}, {}
    for number, block in enumerate(blocks_of(page.read_text(encoding="utf-8"))):
        if block.file is not None:
            Path(block.file).write_text(block.body, encoding="utf-8")
        elif block.language == "python":
            with contextlib.redirect_stdout(io.StringIO()) as out:
                program = compile(block.body, f"{page.name}, block {number}", "exec", dont_inherit=True)
                exec(program, names)
            printed[number] = out.getvalue()
        elif block.language == "bash":
            printed[number] = _shell(block.body)
    result.write_text(json.dumps(printed), encoding="utf-8")


def _shell(commands: str) -> str:
    """What the commands of a shell print; progress and messages, on standard error, are not part of it."""
    here = "\n".join(line for line in commands.splitlines() if not ELSEWHERE.match(line))
    # A file and no pipe: programs in the background would keep that open.
    with tempfile.TemporaryFile("w+", encoding="utf-8") as out:
        subprocess.run(["bash", "-euo", "pipefail", "-c", here], check=True, stdout=out)
        out.seek(0)
        return out.read()


def renew(page: Path) -> None:
    """Write what the blocks of a page print, and the pictures that they draw, into the page and beside it."""
    text = page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        printed = run_page(page, Path(folder))
        for number, below in sorted(printed_below(text).items(), reverse=True):
            shown = "\n".join(line.rstrip() for line in printed[number].strip("\n").splitlines())
            text = f"{text[: below.begin]}{shown}\n{text[below.end :]}"
        page.write_text(text, encoding="utf-8")
        for name in PICTURE.findall(text):
            drawn = Path(folder, Path(name).name)
            if drawn.is_file():
                (page.parent / name).write_bytes(drawn.read_bytes())


if __name__ == "__main__":
    if sys.argv[1] == "--inside":
        _run_inside(Path(sys.argv[2]), Path(sys.argv[3]))
    else:
        for argument in sys.argv[1:]:
            renew(Path(argument))
            print(argument)
