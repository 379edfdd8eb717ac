"""Files of configuration: what is read, what is refused, and which one is nearest."""

import pytest

from mapdeal.checks.findings import LintConfig, find_lint_config, read_lint_config
from mapdeal.errors import FileAccessError, MalformedInputError, ParameterError

BODY = """select = ["image", "yaml.origin-yaw"]
ignore = ["image.greys"]
strict = true
severity = {"image.lossy" = "error"}

[{table}.per-file-ignores]
"legacy/*" = ["all"]
"""


@pytest.mark.parametrize(
    ("name", "table"), [("mapdeal.toml", "lint"), ("pyproject.toml", "tool.mapdeal.lint")]
)
def test_a_table_is_read_as_it_is_written(tmp_path, name, table):
    path = tmp_path / name
    path.write_text(f"[{table}]\n{BODY.replace('{table}', table)}")
    assert read_lint_config(path) == LintConfig(
        path, table, ("image", "yaml.origin-yaw"), ("image.greys",), strict=True,
        per_file_ignores=(("legacy/*", ("all",)),), severity=(("image.lossy", "error"),),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("text", "told", "hint"),
    [
        ("[lint]\nselct = []\n", "lint.selct: unknown key", "did you mean select?"),
        ("[lint]\nxyz = 1\n", "lint.xyz: unknown key", "known keys: select, ignore, strict"),
        ("strict = true\n", "strict: unknown key", "it belongs in the table [lint]"),
        ("[lnt]\n", "lnt: unknown key", "did you mean lint?"),
        ("lint = 3\n", "lint: must be a table, got 3", ""),
        ('[lint]\nselect = "image"\n', "lint.select: must be a list of names, got 'image'", ""),
        ("[lint]\nignore = [1]\n", "lint.ignore: must be a list of names, got [1]", ""),
        ("[lint]\nstrict = 1\n", "lint.strict: must be true or false, got 1", ""),
        ("[lint]\nper-file-ignores = []\n", "lint.per-file-ignores: must be a table of", ""),
        ("[lint]\nper-file-ignores = {a = 1}\n", 'lint.per-file-ignores."a": must be a list', ""),
        ("[lint]\nseverity = {x = 'bad'}\n", 'lint.severity."x": must be error, warning or', ""),
        ("[lint]\nseverity = {x = []}\n", 'lint.severity."x": must be error, warning or', ""),
        ("[lint]\nseverity = 1\n", "lint.severity: must be a table of names", ""),
    ],
)
def test_what_cannot_be_is_refused_with_file_and_key(tmp_path, text, told, hint):
    path = tmp_path / "mapdeal.toml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        read_lint_config(path)
    assert str(caught.value).startswith(f"{path}: {told}")
    assert (caught.value.hint or "").startswith(hint)


@pytest.mark.parametrize(
    "data",
    [b"[lint\n", b"\xff", b"a = " + b"[" * 5000, b"a = " + b"7" * 5000, b"x" * (1 << 21)],
)
def test_what_is_no_toml_is_malformed(tmp_path, data):
    path = tmp_path / "mapdeal.toml"
    path.write_bytes(data)
    with pytest.raises(MalformedInputError, match=r"mapdeal\.toml: "):
        read_lint_config(path)


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileAccessError, match=r"none\.toml: cannot be read"):
        read_lint_config(tmp_path / "none.toml")


def test_other_tools_tables_are_their_own(tmp_path):
    path = tmp_path / "pyproject.toml"
    path.write_text("[tool.ruff]\nx = 1\n[project]\nname = 'y'\n")
    assert read_lint_config(path) is None
    path.write_text("[tool.mapdeal]\nlnt = {}\n")
    with pytest.raises(ParameterError, match=r"tool\.mapdeal\.lnt: unknown key"):
        read_lint_config(path)
    for text in ("tool = 1\n", "[tool]\nmapdeal = 1\n"):
        path.write_text(text)
        if "mapdeal" in text:
            with pytest.raises(ParameterError, match="must be a table"):
                read_lint_config(path)
        else:
            assert read_lint_config(path) is None


def test_the_nearest_file_with_a_table_is_found(tmp_path, monkeypatch):
    deep = tmp_path / "a" / "b" / "c"
    deep.mkdir(parents=True)
    top = tmp_path / "pyproject.toml"
    top.write_text("[tool.mapdeal.lint]\nstrict = true\n")
    (tmp_path / "a" / "b" / "pyproject.toml").write_text("[project]\n")
    assert find_lint_config(deep).source == top
    own = tmp_path / "a" / "mapdeal.toml"
    own.write_text("")
    (tmp_path / "a" / "pyproject.toml").write_text("[tool.mapdeal.lint]\n")
    assert find_lint_config(deep) == LintConfig(own, "lint")
    monkeypatch.chdir(deep)
    assert find_lint_config(tmp_path.relative_to(tmp_path)) == LintConfig(own, "lint")
    assert find_lint_config(tmp_path).source == top
