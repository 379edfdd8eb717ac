import importlib.util
import io
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from importlib.machinery import SourceFileLoader
from pathlib import Path

import pytest
import yaml

from mapdeal.compatibility import parse_toml
from mapdeal.version import __version__

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
GITHUB = ROOT / ".github"
WORKFLOWS = sorted((GITHUB / "workflows").glob("*.yml"))
COLCON = Path(sys.executable).with_name("colcon")
PROJECT = parse_toml((ROOT / "pyproject.toml").read_text("utf-8"))


@pytest.fixture
def script(monkeypatch):
    """Return what imports a script of a hidden folder."""
    monkeypatch.syspath_prepend(ROOT / ".backend")

    def imported(place):
        loader = SourceFileLoader(Path(place).stem.replace("-", "_"), str(ROOT / place))
        spec = importlib.util.spec_from_loader(loader.name, loader)
        module = importlib.util.module_from_spec(spec)
        loader.exec_module(module)
        return module

    return imported


@pytest.fixture
def sources(script):
    return script(".backend/project_sources.py")


def test_without_git_the_same_files_belong_to_the_project(sources, tmp_path):
    files = sources.project_files(ROOT)
    some = {"README.md", ".ci/run", "tests/test_packages.py", "src/mapdeal/kernels/lanes.h"}
    assert some <= set(files)
    generated = [
        "PKG-INFO", "build/lib/a.py", "dist/a.whl", "out/a.pgm", ".venv/bin/python",
        "src/mapdeal.egg-info/SOURCES.txt", "src/mapdeal/kernels/_rays.so", "tests/.cache/x",
        "src/mapdeal/__pycache__/a.pyc", "src/mapdeal/kernels/_rays.c",
    ]  # fmt: skip
    for name in [*files, *generated]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    assert sources.project_files(tmp_path) == sorted(files)


@pytest.mark.skipif(shutil.which("git") is None, reason="needs git")
def test_with_git_untracked_files_do_not_belong_to_the_project(sources, tmp_path):
    for name in ("README.md", "notes.txt", "gone.py", "docs/a.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"")
    for words in (["init", "-q"], ["add", "README.md", "docs", "gone.py"]):
        subprocess.run(["git", "-C", tmp_path, *words], check=True)
    (tmp_path / "gone.py").unlink()
    assert sources.project_files(tmp_path) == ["README.md", "docs/a.md"]


def wheel(path, names):
    with zipfile.ZipFile(path, "w") as file:
        for name in names:
            file.writestr(name, b"")
    return path


def test_a_wheel_has_all_kernels_and_the_package_alone(script, tmp_path):
    kernels = [path.stem for path in (ROOT / "src/mapdeal/kernels").glob("*.pyx")]
    assert len(kernels) >= 6
    good = ["mapdeal/__init__.py", "mapdeal-0.1.0.dist-info/METADATA"]
    good += [f"mapdeal/kernels/{name}.cpython-313-x86_64-linux-gnu.so" for name in kernels]
    flaws_of = script(".ci/check-packages").flaws_of_wheel
    assert flaws_of(wheel(tmp_path / "a.whl", good)) == []
    assert flaws_of(wheel(tmp_path / "a.whl", [*good, "tests/a.py"])) == ["contains tests/"]
    assert flaws_of(wheel(tmp_path / "a.whl", [*good[:-1], "mapdeal/kernels/lanes.h"])) == [
        "contains mapdeal/kernels/lanes.h", f"lacks the compiled kernel {kernels[-1]}",
    ]  # fmt: skip


def test_a_source_distribution_has_every_file(script, sources, tmp_path):
    with tarfile.open(tmp_path / "a.tar.gz", "w:gz") as file:
        for name in sources.project_files(ROOT):
            if name != "tests/drawn.py":
                file.addfile(tarfile.TarInfo(f"mapdeal-0.1.0/{name}"), io.BytesIO())
    assert script(".ci/check-packages").missing_sources(tmp_path / "a.tar.gz") == {"tests/drawn.py"}


@pytest.mark.thorough
@pytest.mark.skipif(not COLCON.exists(), reason="needs colcon")
def test_colcon_installs_into_a_ros_2_workspace(sources, tmp_path, monkeypatch):
    checkout = tmp_path / "src" / "mapdeal"
    for name in sources.project_files(ROOT):
        (checkout / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, checkout / name)
    files = {path for path in checkout.rglob("*") if path.is_file()}
    monkeypatch.setenv("MAPDEAL_KERNELS", "scipy")  # which spares the test two minutes
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    words = [COLCON, "build", "--base-paths", "src", "src/mapdeal/.github/ros"]
    subprocess.run(words, cwd=tmp_path, check=True, capture_output=True)
    assert {path for path in checkout.rglob("*") if path.is_file()} == files
    installed = tmp_path / "install" / "mapdeal"
    assert (installed / "share/ament_index/resource_index/packages/mapdeal").is_file()
    package = (installed / "share/mapdeal/package.xml").read_text("utf-8")
    assert f"<version>{__version__}</version>" in package
    command = ". install/local_setup.sh; exec install/mapdeal/lib/mapdeal/mapdeal"
    maps = checkout / "examples" / "maps"
    for line in ("--version", f"run {maps}/office.yaml -o out --recipe nav2 --robot-radius 0.2"):
        subprocess.run(["sh", "-c", f"{command} {line}"], cwd=tmp_path, check=True)
    assert (tmp_path / "out" / "office" / "cost.npz").is_file()


def test_headers_of_a_kernel_are_named_where_it_is_built():
    modules = PROJECT["tool"]["setuptools"]["ext-modules"]
    folder = ROOT / "src/mapdeal/kernels"
    assert {ROOT / module["sources"][0] for module in modules} == set(folder.glob("*.pyx"))
    assert all(module["optional"] for module in modules)

    def included(path):
        line = r'(?m)^(?:#include|cdef extern from) "(\w+\.h)"'
        found = set(re.findall(line, path.read_text()))
        return found.union(*(included(folder / name) for name in found)) if found else set()

    for module in modules:
        (source,) = module["sources"]
        assert {Path(name).name for name in module["depends"]} == included(ROOT / source)


COMPILER = shutil.which("cc")
HEADERS = sorted((ROOT / "src/mapdeal/kernels").glob("*.h"))
NAMES = "float", "locale", "math", "stddef", "stdint", "stdlib", "string"
STANDARD = "".join(f"#include <{name}.h>\n" for name in NAMES)


@pytest.mark.skipif(COMPILER is None, reason="needs a C compiler")
@pytest.mark.parametrize("header", HEADERS, ids=lambda path: path.name)
def test_kernels_are_plain_c11_where_the_compiler_is_not_gcc(header, tmp_path):
    """Neither gcc's extensions nor arrays of variable length, which Microsoft's compiler lacks."""
    hidden = "#undef __GNUC__\n#undef __SIZEOF_INT128__\n#undef __BYTE_ORDER__\n"
    text = f'{STANDARD}{hidden}#include "{header.name}"\n'
    (tmp_path / "a.c").write_text(text)
    strict = ["-std=c11", "-pedantic-errors", "-Werror=vla", "-fsyntax-only"]
    words = [COMPILER, *strict, f"-I{header.parent}", str(tmp_path / "a.c")]
    completed = subprocess.run(words, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr


@pytest.mark.thorough
@pytest.mark.parametrize(("schema", "files"), [
    ("github-workflows", "workflows/*.yml"),
    ("github-issue-forms", "ISSUE_TEMPLATE/[bfq]*.yml"),
    ("github-issue-config", "ISSUE_TEMPLATE/config.yml"),
    ("dependabot", "dependabot.yml"),
    ("github-actions", "actions/*/action.yml"),
    ("citation-file-format", "CITATION.cff"),
])  # fmt: skip
def test_files_of_the_project_are_as_their_schemas_say(schema, files):
    pytest.importorskip("check_jsonschema")
    paths = sorted(map(str, GITHUB.glob(files)))
    assert paths
    words = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", f"vendor.{schema}"]
    completed = subprocess.run([*words, *paths], capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout + completed.stderr


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_has_few_rights_and_actions_of_known_versions(path):
    workflow = yaml.safe_load(path.read_text("utf-8"))
    assert workflow["permissions"] == {"contents": "read"}
    for job in workflow["jobs"].values():
        assert "timeout-minutes" in job or "uses" in job
        for step in job.get("steps", []):
            assert "${{" not in step.get("run", "")  # what users name is never part of a script
            action = step.get("uses", "")
            assert not action or re.search(r"@(v\d+|[0-9a-f]{40}|release/v\d+)$", action)
            if action.startswith("actions/checkout@"):
                assert step["with"]["persist-credentials"] is False


def test_ci_runs_the_two_commands_of_readme_on_every_python():
    job = yaml.safe_load((GITHUB / "workflows" / "test.yml").read_text("utf-8"))["jobs"]["linux"]
    blocks = re.findall(r"(?m)^(python3 -m venv .*)$", (ROOT / "README.md").read_text("utf-8"))
    assert len(blocks) == 2
    script = (ROOT / ".ci" / "run").read_text("utf-8").splitlines()
    for runs in ([step.get("run") for step in job["steps"]], script):
        assert [block for block in blocks if block not in runs] == []
    pythons = re.findall(r":: (3\.\d+)", "\n".join(PROJECT["project"]["classifiers"]))
    assert job["strategy"]["matrix"]["python"] == pythons
    built = [name.removesuffix("-*") for name in PROJECT["tool"]["cibuildwheel"]["build"]]
    assert built == [f"cp{python.replace('.', '')}" for python in pythons]


def test_the_citation_is_of_this_version():
    citation = yaml.safe_load((GITHUB / "CITATION.cff").read_text("utf-8"))
    assert f'"{citation["version"]}"' in (ROOT / "src/mapdeal/version.py").read_text("utf-8")


def test_a_release_needs_its_own_tag_and_a_dated_changelog(tmp_path, script):
    flaws_of = script(".ci/check-tag").flaws_of
    (tmp_path / "src/mapdeal").mkdir(parents=True)
    (tmp_path / "src/mapdeal/version.py").write_text('__version__ = "1.2.3"\n')
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## 1.2.3 (2027-01-02)\n\n## 1.2.2\n")
    assert flaws_of("v1.2.3", tmp_path) == []
    (flaw,) = flaws_of("v1.2.4", tmp_path)
    assert flaw == "the tag is v1.2.4, and the version in src/mapdeal/version.py is 1.2.3"
    (tmp_path / "CHANGELOG.md").write_text("# Changelog\n\n## 1.2.3 (unreleased)\n")
    assert len(flaws_of("v1.2.3", tmp_path)) == 1
