"""README, CONTRIBUTING and the pages of docs: every block of code runs, prints what stands below it and
draws the pictures that are shown; the site builds without a warning.
"""

import importlib.util
import os
import re
import subprocess
import sys
import tomllib

import pytest
from code_blocks import ELSEWHERE, PICTURE, ROOT, blocks_of, printed_below, run_page
from typer.testing import CliRunner

import jaxmuscle
from jaxmuscle.cli import app

PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))
}
RUNNING = [name for name, path in PAGES.items() if any(b.runs for b in blocks_of(path.read_text("utf-8")))]
QUICK = {"docs/index.md", "docs/how-to/gpu.md", "CONTRIBUTING.md"}
"""Pages whose blocks take seconds."""
FIRST = {"README.md", "docs/tutorial.md"}
"""Those that a newcomer begins with."""
SCREENSHOT = "report.png"
"""What no page draws: the report in a browser, by ``python tests/report_picture.py``."""
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
SHOWN = {"python", "bash", "text", "toml"}


def words_and_numbers(text):
    """A text without the spaces that align it: its words with # for every number, and the numbers."""
    plain = " ".join(text.split())
    return NUMBER.sub("#", plain), [float(number) for number in NUMBER.findall(plain)]


def runs(name):
    later = pytest.mark.slow if name in FIRST else pytest.mark.thorough
    return pytest.param(name, marks=() if name in QUICK else later, id=name)


@pytest.mark.usefixtures("kept_programs")
@pytest.mark.parametrize("name", [runs(name) for name in RUNNING])
def test_every_block_runs_and_prints_what_stands_below_it(name, tmp_path):
    text = PAGES[name].read_text(encoding="utf-8")
    printed = run_page(PAGES[name], tmp_path)
    for number, below in printed_below(text).items():
        ours, theirs = words_and_numbers(printed[number]), words_and_numbers(below.body)
        assert ours[0] == theirs[0]
        # The last digits may differ between machines, as in the notebooks.
        assert ours[1] == pytest.approx(theirs[1], rel=0.05, abs=1e-9)
    drawn = [picture.rpartition("/")[2] for picture in PICTURE.findall(text)]
    drawn = [picture for picture in drawn if picture != SCREENSHOT]
    assert [picture for picture in drawn if not (tmp_path / picture).is_file()] == []
    if name == "README.md":
        assert "load_friction" in printed[min(printed)]


def test_pages_with_code_are_found():
    assert {"README.md", "CONTRIBUTING.md", "docs/tutorial.md", "docs/how-to/rig.md"} <= set(RUNNING)
    assert set(RUNNING) >= QUICK


@pytest.mark.parametrize("name", PAGES)
def test_no_block_escapes_the_tests(name):
    text = PAGES[name].read_text(encoding="utf-8")
    found = blocks_of(text)
    assert {block.language for block in found} <= SHOWN
    # Every fence belongs to a block that was found, or has no language and is no code.
    assert len(re.findall(r"^ *```\w", text, flags=re.M)) == len(found)
    for block in found:
        if block.language == "toml":
            tomllib.loads(block.body)


def test_what_is_installed_is_there():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    texts = "\n".join(path.read_text(encoding="utf-8") for path in PAGES.values())
    named = re.findall(r"pip install (?:-e )?'\.\[([\w,]+)\]'", texts)
    assert len(named) >= 3
    assert {each for group in named for each in group.split(",")} <= set(extras)
    assert ELSEWHERE.match("python -m pip install .") and not ELSEWHERE.match("jaxmuscle diagnose")


def test_the_version_is_the_same_everywhere():
    cited = re.findall(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), flags=re.M)
    changed = re.findall(r"^## ([\d.]+)", (ROOT / "CHANGELOG.md").read_text("utf-8"), flags=re.M)
    assert cited == [jaxmuscle.__version__] == changed[:1]
    assert changed == sorted(changed, key=lambda each: [*map(int, each.split("."))], reverse=True)


def test_readme_is_short_and_points_to_the_pages():
    readme = PAGES["README.md"].read_text(encoding="utf-8")
    assert len(readme.splitlines()) < 200
    targets = re.findall(r"\]\(((?!https?:)[^)#]+)[^)]*\)", readme)
    assert [target for target in targets if not (ROOT / target).exists()] == []
    assert "docs/tutorial.md" in targets


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("mkdocs") is None, reason="needs mkdocs: pip install '.[docs]'")
def test_site_builds_without_a_warning(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    pages = {path.relative_to(tmp_path / "site").as_posix() for path in (tmp_path / "site").rglob("*.html")}
    assert {"tutorial.html", "reference/cards.html", "reference/python/effects.html"} <= pages
    effects = (tmp_path / "site" / "reference" / "effects.html").read_text(encoding="utf-8")
    assert 'id="load_friction"' in effects and "<math" in effects and "arithmatex" not in effects
    commands = (tmp_path / "site" / "reference" / "commands.html").read_text(encoding="utf-8")
    for name in ("diagnose", "init", "check", "fit", "sweep"):
        told = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200"}).stdout
        options = set(re.findall(r"--[a-z][a-z-]+", told)) - {"--help"}
        assert options and [option for option in options if option not in commands] == []
    # Nothing is loaded from elsewhere.
    for name in pages:
        page = (tmp_path / "site" / name).read_text(encoding="utf-8")
        assert not re.search(r'<(?:script|link|img)[^>]*(?:src|href)="https?:', page), name
