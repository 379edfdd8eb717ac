"""The commands in README and docs, run as they are printed."""

import importlib.util
import re
import shlex
import shutil
import sys
from collections import Counter
from pathlib import Path

import pytest
from PIL import Image

import mapdeal
from mapdeal.stages.catalogue import STAGES

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    # Translations hold the same blocks as the English pages, which a test of their own checks.
    *(page for page in sorted((ROOT / "docs").rglob("*.md")) if not page.name.endswith(".zh.md")),
]


def _blocks(page, language):
    return re.findall(rf"(?ms)^```{language}\n(.*?)^```", page.read_text())


def _name(page):
    return page.relative_to(ROOT).as_posix()


def _script(name):
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    script = importlib.util.module_from_spec(spec)
    sys.modules[name] = script  # where data classes look for their module
    spec.loader.exec_module(script)
    return script


@pytest.fixture
def tables(tmp_path, monkeypatch):
    script = _script("tables")
    for page in script.PAGES:
        shutil.copy(ROOT / "docs" / page, tmp_path)
    monkeypatch.setattr(script, "DOCS", tmp_path)
    return script


@pytest.fixture
def project(tmp_path, monkeypatch, one_core):
    """Work in a folder with the examples, as the reader does."""
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    # Tests of their own check compressed bytes and maps in processes.
    monkeypatch.setattr("mapdeal.maps.png._LEVEL", 0)
    monkeypatch.setattr("mapdeal.report.tiles._COMPRESSION", 1)
    monkeypatch.setattr("mapdeal.pipeline.batch.jobs_at_once", lambda *_: 1)


def _run(line, command):
    """Run a line as a shell would; return its stdout and stderr."""
    printed = ["", ""]
    for part in line.split("&&"):
        words = shlex.split(part.strip().removeprefix(".venv/bin/"), comments=True)
        match = re.search(r"# exit code (\d)", part)
        end = -2 if words[-2:-1] == [">"] else None
        code, out, err = command(*words[1:end])
        assert code == (int(match[1]) if match else 0), f"{part}: {err}"
        if end is not None:  # what the shell does
            Path(words[-1]).write_text(out)
            out = ""
        printed = [printed[0] + out, printed[1] + err]
    return printed


@pytest.mark.parametrize("page", PAGES, ids=_name)
def test_every_command_of_a_page_runs_and_prints_what_is_shown(page, project, command):
    printed: list[list[str]] = []
    for kind, block in _blocks(page, "(sh|text)"):
        if kind == "sh":
            lines = re.findall(r"(?m)^ *(?:\.venv/bin/)?(mapdeal .*)", block.replace("\\\n", " "))
            printed = [_run(line, command) for line in lines]
            continue
        assert printed, f"no command prints {block}"
        streams = ["".join(texts).splitlines() for texts in zip(*printed, strict=True)]
        for line in block.splitlines():  # those that are shown, in order; others are left out
            if line.strip() not in ("", "..."):
                stream = next((shown_lines for shown_lines in streams if line in shown_lines), None)
                assert stream is not None, f"{line!r} is not printed there, but {streams}"
                del stream[: stream.index(line) + 1]
    pictures = _script("figures").PICTURES.get(_name(page).removeprefix("docs/"), {})
    for name, file in pictures.items():
        drawn, shown = _colours(file), _colours(ROOT / "docs" / "images" / name)
        for colour in drawn | shown:  # letters may differ between versions of Pillow
            counts = drawn[colour], shown[colour]
            near = pytest.approx(max(counts), rel=0.02, abs=1000)
            assert counts[0] == near == counts[1], f"{name} is outdated: run docs/figures.py"


def _colours(picture):
    with Image.open(picture) as image:
        pixels = image.convert("RGB")
        return Counter(dict(map(reversed, pixels.getcolors(pixels.width * pixels.height))))


@pytest.mark.parametrize("page", [page for page in PAGES if _blocks(page, "python")], ids=_name)
def test_every_python_example_of_a_page_runs(page, project, capsys):
    shown = []
    for block in _blocks(page, "python"):
        exec(compile(block, page.name, "exec"), {})  # noqa: S102
        shown += re.findall(r"^print\(.*\)  # (.*)$", block, re.MULTILINE)
    if page.name == "python.md":  # there, comments after print show its output
        assert len(shown) > 5
        assert [line for line in capsys.readouterr().out.splitlines() if line in shown] == shown


def test_readme_leads_to_every_page_and_that_of_python_shows_a_grid_as_it_is(project):
    shown = repr(mapdeal.read_map("examples/maps/office.yaml"))
    assert f"```\n{shown}\n```" in (ROOT / "docs" / "python.md").read_text()
    text = (ROOT / "README.md").read_text()
    linked = set(re.findall(r"\]\((docs/[a-z0-9_/]+\.md)\)", text))
    assert linked == {_name(page) for page in PAGES[1:]}
    assert "](docs/README.zh.md)" in text


def test_every_module_that_architecture_names_is_there():
    known = [f"/{path.relative_to(ROOT).as_posix()}" for path in ROOT.glob("[!.]*/**/*.*")]
    text = (ROOT / "docs" / "architecture.md").read_text()
    named = set(re.findall(r"`([\w/]+\.(?:py|pyi|pyx|h))`", text))
    assert len(named) > 20
    assert not {name for name in named if not any(path.endswith(f"/{name}") for path in known)}


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: f"{stage.name} {stage.model or ''}")
def test_every_stage_has_its_parameters_in_the_docs(stage):
    words = " ".join(filter(None, ("parameters of", stage.name, stage.model)))
    assert f"<!-- {words} -->" in (ROOT / "docs" / "stages.md").read_text()


def test_tables_say_what_the_code_says(tables):
    assert tables.main(["--check"]) == 0


def test_a_cell_that_was_edited_is_found_and_put_right(tables):
    page = tables.DOCS / "stages.md"
    text = page.read_text()
    edited = text.replace("| 0.3 |", "| 0.4 |", 1)
    page.write_text(edited)
    assert tables.main(["--check"]) == 1
    assert page.read_text() == edited != text
    assert tables.main([]) == 0
    assert page.read_text() == text
