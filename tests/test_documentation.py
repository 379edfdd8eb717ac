"""The commands in README and docs, run as they are printed."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def _blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)


def _commands(page):
    for block in _blocks(page, "sh"):
        for line in block.replace("\\\n", " ").splitlines():
            line = line.strip().removeprefix(".venv/bin/")
            if line.startswith("mapdeal "):
                yield line


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A folder with the examples, as the reader's."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_command_of_a_page_runs(page, project, command):
    for line in _commands(page):
        for part in line.split("&&"):
            words = shlex.split(part.strip().removeprefix(".venv/bin/"), comments=True)
            expected = 0
            if "exit code" in part and (match := re.search(r"# exit code (\d)", part)):
                expected = int(match[1])
            code, _, err = command(*words[1:])
            assert code == expected, f"{part}: {err}"


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_python_example_of_a_page_runs(page, project, capsys):
    for block in _blocks(page, "python"):
        exec(compile(block, page.name, "exec"), {})  # noqa: S102


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text()):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_ci_runs_the_two_commands_as_readme_prints_them():
    set_ups = [block.strip() for block in _blocks(ROOT / "README.md", "sh")][:2]
    lines = (ROOT / ".ci" / "run").read_text().splitlines()
    assert len(set_ups) == 2
    for line in set_ups:
        assert line in lines
