"""Which findings count, against rules in plain Python."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mapdeal.checks.findings import (
    CHECKS,
    Finding,
    IgnoreComment,
    LintConfig,
    Selection,
    selection_of,
)
from mapdeal.errors import ParameterError

NAMES = ["all", "image", "image.", "image.alpha", "map", "map.specks", "yaml.origin-yaw", "yaml"]


def config(tmp_path=Path("/p"), **values):
    return LintConfig(tmp_path / "mapdeal.toml", "lint", **values)


def precision(name, texts):
    """How precisely a check is named: 2 by itself, 1 by its area, 0 by all, -1 not at all."""
    ranks = [
        2 if text == name else 1 if text.rstrip(".") == name.split(".")[0] else 0
        for text in texts
        if text in (name, "all") or text.rstrip(".") == name.split(".")[0]
    ]
    return max(ranks, default=-1)


def chosen(before, select, ignore):
    if select:
        return {n for n in CHECKS if precision(n, select) > precision(n, ignore)}
    return {n for n in before if precision(n, ignore) < 0}


some = st.lists(st.sampled_from(NAMES), max_size=3)


@given(select=some, ignore=some, of_file=st.tuples(some, some))
def test_the_more_precise_name_wins_and_the_caller_comes_after_the_file(select, ignore, of_file):
    of_config = config(select=tuple(of_file[0]) or None, ignore=tuple(of_file[1]))
    made = selection_of(select, ignore, config=of_config)
    assert made.checks == chosen(chosen(CHECKS, *of_file), select, ignore)


def test_all_checks_are_wanted_by_default():
    assert selection_of().checks == set(CHECKS)


def test_an_empty_select_in_a_file_selects_nothing():
    assert selection_of(config=config(select=())).checks == set()


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("image.palete", "did you mean image.palette?"),
        ("imag", "did you mean image?"),
        ("palette", "did you mean image.palette?"),
        ("map.no", "did you mean map.no-free?"),
        ("", "areas are"),
        ("qqqq", "areas are file, yaml, thresholds"),
    ],
)
def test_an_unknown_name_is_an_error_with_a_hint(text, hint):
    with pytest.raises(ParameterError) as caught:
        selection_of([text])
    assert str(caught.value).startswith("--select: unknown check, got ")
    assert caught.value.hint.startswith(hint)
    for values, place in [
        ({"select": (text,)}, "lint.select"), ({"ignore": (text,)}, "lint.ignore"),
        ({"per_file_ignores": (("a", (text,)),)}, 'lint.per-file-ignores."a"'),
        ({"severity": ((text, "error"),)}, "lint.severity"),
    ]:  # fmt: skip
        with pytest.raises(ParameterError) as caught:
            selection_of(config=config(**values))
        assert str(caught.value).startswith(f"/p/mapdeal.toml: {place}: unknown check")


def found(*names):
    return [Finding(name, CHECKS[name].severity, "m.yaml", "told") for name in names]


def names_of(findings):
    return [one.check for one in findings]


YAW, ALPHA, SPECKS = "yaml.origin-yaw", "image.alpha", "map.specks"


def test_findings_that_are_not_wanted_are_not_suppressed_but_gone():
    kept, suppressed = selection_of(["image"]).judged(Path("m.yaml"), found(YAW, ALPHA))
    assert (names_of(kept), suppressed) == ([ALPHA], 0)


def test_a_comment_suppresses_checks_and_areas():
    comments = [IgnoreComment(3, (YAW, "image"))]
    findings = found(YAW, ALPHA, SPECKS, ALPHA)
    kept, suppressed = selection_of().judged(Path("m.yaml"), findings, comments)
    assert (names_of(kept), suppressed) == ([SPECKS], 3)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), "names no check: write # mapdeal: ignore AREA.NAME"),
        ((ALPHA,), "image.alpha ignores nothing here"),
        (("map",), "map ignores nothing here"),
        (("yaml.orign-yaw",), "unknown check yaml.orign-yaw; did you mean yaml.origin-yaw?"),
        (("lint.unused-ignore",), "lint.unused-ignore ignores nothing here"),
    ],
)
def test_a_comment_that_ignores_nothing_is_told(names, message):
    comments = [IgnoreComment(4, names)]
    kept, suppressed = selection_of().judged(Path("m.yaml"), found(YAW), comments)
    assert (names_of(kept), suppressed) == ([YAW, "lint.unused-ignore"], 0)
    assert (kept[1].message, kept[1].line, kept[1].severity) == (message, 4, "note")
    kept, _ = selection_of([], ["lint"]).judged(Path("m.yaml"), found(YAW), comments)
    assert names_of(kept) == [YAW]


def test_a_comment_on_a_check_that_is_not_wanted_is_used_all_the_same():
    comments = [IgnoreComment(1, (YAW,))]
    kept, suppressed = selection_of([], ["yaml"]).judged(Path("m.yaml"), found(YAW), comments)
    assert (kept, suppressed) == ((), 0)


@pytest.mark.parametrize(
    ("pattern", "is_spared"),
    [
        ("m.yaml", True),
        ("*.yaml", True),
        ("old", True),
        ("old/", True),
        ("old/*", True),
        ("old/deep", True),
        ("old/deep/m.yaml", True),
        ("*/deep/*", True),
        ("**/m.yaml", True),
        ("o[l]d/?eep/*", True),
        ("deep", False),
        ("new/*", False),
        ("n.yaml", False),
        ("../*", False),
    ],
)
def test_patterns_are_of_names_below_the_files_folder(tmp_path, pattern, is_spared):
    made = selection_of(config=config(tmp_path, per_file_ignores=((pattern, ("image",)),)))
    kept, suppressed = made.judged(tmp_path / "old/deep/m.yaml", found(YAW, ALPHA))
    assert (names_of(kept), suppressed) == (([YAW], 1) if is_spared else ([YAW, ALPHA], 0))
    kept, suppressed = made.judged(tmp_path.parent / "m.yaml", found(YAW, ALPHA))
    assert suppressed == 0


def test_severities_can_be_changed_and_the_worst_comes_first():
    of_config = config(severity=(("image.alpha", "error"), ("image", "note"), ("all", "warning")))
    made = selection_of(config=of_config)
    kept, _ = made.judged(Path("m.yaml"), found(YAW, "image.colour", ALPHA, SPECKS))
    assert [(one.check, one.severity) for one in kept] == [
        (ALPHA, "error"), (YAW, "warning"), (SPECKS, "warning"), ("image.colour", "note"),
    ]  # fmt: skip


def test_strict_comes_from_either():
    assert selection_of(strict=True).strict
    assert selection_of(config=config(strict=True)).strict
    assert not selection_of(config=config()).strict
    assert isinstance(selection_of(), Selection)
