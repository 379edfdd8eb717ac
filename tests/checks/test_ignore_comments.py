"""Comments in a map's YAML file that name checks to be ignored."""

import pytest

from mapdeal.checks.findings import IgnoreComment, read_ignore_comments


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("# mapdeal: ignore yaml.origin-yaw", ["yaml.origin-yaw"]),
        ("negate: 0  # mapdeal: ignore yaml.origin-yaw, image", ["yaml.origin-yaw", "image"]),
        ("#mapdeal:ignore image.,map the dock is old, and turned", ["image.", "map"]),
        ("\t#\tmapdeal:\tignore\timage ,\tmap", ["image", "map"]),
        ("# mapdeal: ignore", []),
        ("# mapdeal: ignore: image", ["image"]),
        ("# mapdeal: ignore image,", ["image"]),
        ("# see below  # mapdeal: ignore image", ["image"]),
    ],
)  # fmt: skip
def test_names_stand_behind_the_words(tmp_path, line, names):
    path = tmp_path / "m.yaml"
    path.write_bytes(b"\xef\xbb\xbfimage: m.pgm\r\n" + line.encode() + b"\r\nmode: raw\n")
    assert read_ignore_comments(path) == [IgnoreComment(2, tuple(names))]


@pytest.mark.parametrize(
    "line",
    ["# mapdeal: ignored image", "# mapdeal: ignore-image", "x#mapdeal: ignore image", "# ignore",
     "# Mapdeal: ignore image"],
)  # fmt: skip
def test_other_comments_are_for_people(tmp_path, line):
    path = tmp_path / "m.yaml"
    path.write_text(f"{line}\n")
    assert read_ignore_comments(path) == []


def test_a_file_that_cannot_be_read_has_none(tmp_path):
    assert read_ignore_comments(tmp_path / "none.yaml") == []
    (tmp_path / "large.yaml").write_text("# mapdeal: ignore image\n" * 10_000)
    assert read_ignore_comments(tmp_path / "large.yaml") == []
    (tmp_path / "odd.yaml").write_bytes(b"\xff\xfe\n# mapdeal: ignore image\n")
    assert read_ignore_comments(tmp_path / "odd.yaml") == [IgnoreComment(2, ("image",))]
