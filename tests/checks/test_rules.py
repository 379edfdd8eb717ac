"""Selection of findings by comments and configuration, against rules in plain Python."""

from pathlib import Path

import pytest
from hypothesis import example, given, strategies as st

from mapdeal.checks.findings import (
    CHECKS,
    Finding,
    LintConfig,
    find_lint_config,
    read_lint_config,
    selection_of,
)
from mapdeal.checks.lint import lint_file, read_ignored_names  # noqa: F401 - lists all checks
from mapdeal.errors import MalformedInputError, ParameterError

NAMES = [
    "all", "image", "image.", "image.alpha", "image.gamma", "map", "map.specks", "yaml.origin-yaw",
    "yaml",
]  # fmt: skip


def config(**values):
    return LintConfig(Path("/p/mapdeal.toml"), "lint", **values)


def precision(name, texts):
    """Return how precisely a check is named: 2 by itself, 1 by its area, 0 by all, -1 not."""
    ranks = [
        2 if text == name else 1 if text.rstrip(".") == name.split(".")[0] else 0
        for text in texts
        if text in (name, "all") or text.rstrip(".") == name.split(".")[0]
    ]
    return max(ranks, default=-1)


def chosen(before, select, ignore):
    if select is None:
        return {n for n in before if precision(n, ignore) < 0}
    return {n for n in CHECKS if precision(n, select) > precision(n, ignore)}


some = st.lists(st.sampled_from(NAMES), max_size=3).map(tuple)


@example(select=(), ignore=(), of_file=((), ()))  # nothing
@given(select=some, ignore=some, of_file=st.tuples(st.none() | some, some))
def test_the_more_precise_name_wins_and_the_caller_comes_after_the_file(select, ignore, of_file):
    selection = selection_of(select, ignore, config=config(select=of_file[0], ignore=of_file[1]))
    default = {name for name in CHECKS if not CHECKS[name].on_request}
    assert selection.checks == chosen(chosen(default, *of_file), select or None, ignore)


@pytest.mark.parametrize(("text", "hint"), [
    ("image.palete", "did you mean image.palette?"), ("imag", "did you mean image?"),
    ("palette", "did you mean image.palette?"), ("map.no", "did you mean map.no-free?"),
    ("", "groups are"), ("qqqq", "groups are file, yaml, thresholds"),
])  # fmt: skip
def test_an_unknown_name_is_an_error_with_a_hint(text, hint):
    with pytest.raises(ParameterError) as caught:
        selection_of([text])
    assert str(caught.value).startswith("--select: unknown check, got ")
    assert caught.value.hint.startswith(hint)
    for values, place in [
        ({"select": (text,)}, "lint.select"), ({"ignore": (text,)}, "lint.ignore"),
    ]:  # fmt: skip
        with pytest.raises(ParameterError) as caught:
            selection_of(config=config(**values))
        assert str(caught.value).startswith(f"/p/mapdeal.toml: {place}: unknown check")


def findings_of(*names):
    return [Finding(name, CHECKS[name].severity, "m.yaml", "told") for name in names]


def names_of(findings):
    return [finding.check for finding in findings]


YAW, ALPHA, SPECKS = "yaml.origin-yaw", "image.alpha", "map.specks"


def test_a_comment_suppresses_checks_and_areas():
    findings = findings_of(YAW, ALPHA, SPECKS, ALPHA)
    remaining, suppressed = selection_of().apply(findings, (YAW, "image", "yaml.orign-yaw"))
    assert (names_of(remaining), suppressed) == ([SPECKS], 3)
    # findings of unselected checks do not count as suppressed
    remaining, suppressed = selection_of(["image"]).apply(findings_of(YAW, ALPHA), [YAW])
    assert (names_of(remaining), suppressed) == ([ALPHA], 0)


BODY = """select = ["image", "yaml.origin-yaw"]
ignore = ["image.greys"]
strict = true
"""


@pytest.mark.parametrize(
    ("name", "table"), [("mapdeal.toml", "lint"), ("pyproject.toml", "tool.mapdeal.lint")]
)
def test_a_table_is_read_as_it_is_written(tmp_path, name, table):
    path = tmp_path / name
    path.write_text(f"[{table}]\n{BODY}")
    assert read_lint_config(path) == LintConfig(
        path, table, ["image", "yaml.origin-yaw"], ["image.greys"], strict=True
    )


@pytest.mark.parametrize(("text", "error", "hint"), [
    ("[lint]\nselct = []\n", "lint.selct: unknown key", "did you mean select?"),
    ("[lint]\nxyz = 1\n", "lint.xyz: unknown key", "known keys: select, ignore, strict"),
    ("strict = true\n", "strict: unknown key", "it belongs in the table [lint]"),
    ("[lnt]\n", "lnt: unknown key", "did you mean lint?"),
    ("lint = 3\n", "lint: must be a table, got 3", ""),
    ('[lint]\nselect = "image"\n', "lint.select: must be a list of names, got 'image'", ""),
    ("[lint]\nignore = [1]\n", "lint.ignore: must be a list of names, got [1]", ""),
    ("[lint]\nstrict = 1\n", "lint.strict: must be true or false, got 1", ""),
])  # fmt: skip
def test_invalid_values_are_refused_with_file_and_key(tmp_path, text, error, hint):
    path = tmp_path / "mapdeal.toml"
    path.write_text(text)
    with pytest.raises(ParameterError) as caught:
        read_lint_config(path)
    assert str(caught.value).startswith(f"{path}: {error}")
    assert (caught.value.hint or "").startswith(hint)


@pytest.mark.parametrize(
    "data", [b"[lint\n", b"\xff", b"a = " + b"[" * 5000, b"a = " + b"7" * 5000, b"x" * (1 << 21)]
)
def test_invalid_toml_is_malformed(tmp_path, data):
    path = tmp_path / "mapdeal.toml"
    path.write_bytes(data)
    with pytest.raises(MalformedInputError, match=r"mapdeal\.toml: "):
        read_lint_config(path)


def test_other_tools_tables_are_their_own(tmp_path):
    path = tmp_path / "pyproject.toml"
    path.write_text("[tool.ruff]\nx = 1\n[project]\nname = 'y'\n")
    assert read_lint_config(path) is None
    path.write_text("[tool.mapdeal]\nlnt = {}\n")
    with pytest.raises(ParameterError, match=r"tool\.mapdeal\.lnt: unknown key"):
        read_lint_config(path)
    path.write_text("tool = 1\n")
    assert read_lint_config(path) is None
    path.write_text("[tool]\nmapdeal = 1\n")
    with pytest.raises(ParameterError, match="must be a table"):
        read_lint_config(path)


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


@pytest.mark.parametrize(("line", "names"), [
    ("# mapdeal: ignore yaml.origin-yaw", ["yaml.origin-yaw"]),
    ("negate: 0  # mapdeal: ignore yaml.origin-yaw, image", ["yaml.origin-yaw", "image"]),
    ("#mapdeal:ignore image.,map the dock is old, and turned", ["image.", "map"]),
    ("\t#\tmapdeal:\tignore\timage ,\tmap", ["image", "map"]),
    ("# mapdeal: ignore", []),
    ("# mapdeal: ignore: image", ["image"]),
    ("# mapdeal: ignore image,", ["image"]),
    ("# see below  # mapdeal: ignore image", ["image"]),
    *[(line, []) for line in ("# mapdeal: ignored image", "# mapdeal: ignore-image", "# ignore",
                                "x#mapdeal: ignore image", "# Mapdeal: ignore image")],
])  # fmt: skip
def test_names_stand_behind_the_words(tmp_path, line, names):
    path = tmp_path / "m.yaml"
    path.write_bytes(b"\xef\xbb\xbfimage: m.pgm\r\n" + line.encode() + b"\r\nmode: raw\n")
    assert read_ignored_names(path) == tuple(names)


def test_a_file_that_cannot_be_read_has_none(tmp_path):
    assert read_ignored_names(tmp_path / "none.yaml") == ()
    (tmp_path / "large.yaml").write_text("# mapdeal: ignore image\n" * 10_000)
    assert read_ignored_names(tmp_path / "large.yaml") == ()
    (tmp_path / "odd.yaml").write_bytes(b"\xff\xfe\n# mapdeal: ignore image\n")
    assert read_ignored_names(tmp_path / "odd.yaml") == ("image",)
