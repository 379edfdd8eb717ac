"""Bad YAML files: how they are refused, and which are read all the same."""

import os
import re

import pytest

from bad_maps import DRAWING, PGM, cells_of, named, write_map, yaml_text
from drawn import cells
from mapdeal import MalformedInputError
from mapdeal.files.yaml_text import YamlLimits, read_mapping
from traced_memory import memory_below

MALFORMED_FILES = [
    ("Y2-empty", b"", "no mapping in file"),
    ("Y3-list", b"- image: m.pgm\n- resolution: 0.05\n", "mapping"),
    ("Y4-two-documents", yaml_text() + "---\n" + yaml_text(), "line 8"),
    ("Y6-object-tag", yaml_text(image="!!python/object/apply:os.mkdir [hacked]"), "line 1"),
    ("Y6-integer-tag-on-nothing", yaml_text(x='!!int ""'), "x"),
    ("Y6-time-tag-on-a-word", yaml_text(x="!!timestamp noon"), "x"),
    ("Y7-one-alias", yaml_text(a="&a [x]", b="*a"), "aliases are not allowed"),
    ("Y7-merged-aliases", yaml_text(a="&a {k: 1}", b="&b {<<: [*a, *a]}"), "line 9: aliases"),
    ("Y7-nested", yaml_text(x="[" * 20_000 + "]" * 20_000), ""),
    ("Y7-many-ones", yaml_text(x="[" + "1, " * 20_000 + "1]"), "more than 1000 keys and values"),
    ("Y7-sixty-four-kilobytes", yaml_text() + "# filler\n" * 7300, "65536 bytes"),
    ("Y8-nul-byte", yaml_text().encode().replace(b"0.05", b"0.0\x005"), "not UTF-8"),
    ("Y8-utf-16", yaml_text().encode("utf-16"), "not UTF-8"),
    ("Y9-duplicate-key", yaml_text() + "resolution: 0.1\n", "3 and 8"),
    ("Y10-all-missing", "negate: 0\n", "image, resolution, origin"),
    ("Y31-pgm-named-yaml", PGM, "is an image (PNM), not a map"),
]


@pytest.mark.parametrize(("text", "place"), named(MALFORMED_FILES))
def test_yaml_files_that_describe_no_map_are_refused(folder, refused, text, place):
    write_map(folder, text)
    refused(["info", "m.yaml"], 3, "m.yaml", place)
    refused(["run", "m.yaml", "-o", "out"], 3, "m.yaml", place)


MALFORMED_VALUES = [
    ("Y13-decimal-comma", "resolution", "0,05", "'.'"), ("Y14-zero", "resolution", "0", ""),
    ("Y14-nan", "resolution", ".nan", "finite"), ("Y14-sexagesimal", "resolution", "1:30", ""),
    ("Y14-octal", "resolution", "010", ""), ("Y14-boolean", "resolution", "true", ""),
    ("Y14-empty", "resolution", "", ""), ("Y17-two-numbers", "origin", "[1.5, -2.0]", ""),
    ("Y17-null", "origin", "[1.5, null, 0.4]", ""),
    ("Y17-mapping", "origin", "{x: 1.5, y: -2.0, yaw: 0.4}", ""),
    *[("Y18-nan", "origin", f"[1.5, -2.0, {nan}]", "write 0") for nan in ("nan", "-.nan", ".NaN")],
    ("Y22-free-above-occupied", "free_thresh", "0.7", ""),
    ("Y22-below-0", "free_thresh", "-0.1", ""), ("Y22-above-1", "occupied_thresh", "1.5", ""),
    ("Y25-quoted-word", "negate", "'false'", ""), ("Y25-null", "negate", "null", ""),
    ("Y26-unknown-mode", "mode", "ternary", ""),
    ("Y27-roslaunch-path", "image", "$(find maps)/m.pgm", "roslaunch"),
    ("Y27-empty", "image", "''", ""),
]  # fmt: skip


@pytest.mark.parametrize(("key", "value", "hint"), named(MALFORMED_VALUES))
def test_a_value_that_is_not_allowed_is_refused(folder, refused, key, value, hint):
    write_map(folder, yaml_text(**{key: value}))
    refused(["convert", "m.yaml", "-o", "o.npz"], 3, "m.yaml", key, hint=hint)


@pytest.mark.parametrize(("name", "text"), [
    ("missing.yaml", "No such file"), ("missing.npz", "No such file"), ("maps.yaml", "directory"),
    ("loop.yaml", "symbolic links"), ("m.yaml/m.yaml", "Not a directory"),
    *(("n" * 300 + ending, "name too long") for ending in (".yaml", ".npz", ".pgm")),
])  # fmt: skip
def test_a_map_that_cannot_be_opened_is_refused(folder, refused, name, text):
    (folder / "maps.yaml").mkdir()
    (folder / "loop.yaml").symlink_to("loop.yaml")
    refused(["info", name], 4, name[:20], text)
    refused(["run", name, "-o", "out"], 4, name[:20], text)


LIMITS_OF_MAPS = YamlLimits(bytes=300, nodes=20, aliases=2)
EIGHT = "[1, 2, 3, 4, 5, 6, 7, 8]"


@pytest.mark.parametrize(("text", "place"), [
    (f"a: {EIGHT}\nb: [1, 2, 3, 4, 5, 6, 7]\n", None),  # 20 nodes
    (f"a: {EIGHT}\nb: {EIGHT}\n", "line 2: more than 20 keys and values"),
    ("a: &a [1]\nb: *a\nc: *a\n", None),
    ("a: &a [1]\nb: [*a, *a, *a]\n", "line 2: more than 2 aliases"),
    # an alias counts as the keys and items that it repeats
    ("a: &a [1, 1, 1, 1, 1]\nb: [*a, *a]\n", "line 2: more than 20 keys"),
    ("a: &a [1, [*a]]\n", "line 1: an alias within its own anchor"),
    ("a: *b\n", "line 1, column 4: not valid YAML: found undefined alias"),
    ("# " + "x" * 298 + "\n", "must not be larger than 300 bytes"),
])  # fmt: skip
def test_limits_are_the_callers(tmp_path, text, place):
    path = tmp_path / "f.yaml"
    path.write_text(text)
    if place is None:
        assert read_mapping(path, LIMITS_OF_MAPS)
    else:
        with pytest.raises(MalformedInputError, match=re.escape(place)):
            read_mapping(path, LIMITS_OF_MAPS)


def test_a_yaml_of_200_megabytes_is_refused_unread_and_a_pgm_with_its_yaml_named(folder, refused):
    os.truncate(folder / "m.yaml", 200_000_000)
    with memory_below(16_000_000):
        refused(["info", "m.yaml"], 3, "m.yaml", "bytes")
    refused(["info", "m.pgm"], 3, "m.pgm", hint="m.yaml")


NOISE, UTM = "0.05000000074505806", [691608.25, 10000000.1, 0.4]
READABLE = [
    ("Y8-byte-order-mark", b"\xef\xbb\xbf" + yaml_text().encode(), {"resolution": 0.05}),
    ("Y12-exponent-without-a-point", yaml_text(resolution="5e-2"), {"resolution": 0.05}),
    ("Y16-float32-noise", yaml_text(resolution=NOISE), {"resolution": float(NOISE)}),
    ("Y21-utm-origin", yaml_text(origin=str(UTM)), {"origin": UTM}),
    ("Y23-205-below-free_thresh", yaml_text(free_thresh="0.25"), {"free": 4, "unknown": 0}),
    ("Y25-negate-no", yaml_text(negate="no"), {"negate": False, "occupied": 2, "free": 3}),
    ("Y25-negate-true", yaml_text(negate="true"), {"negate": True, "occupied": 4, "free": 2}),
    ("Y26-mode-in-capitals", yaml_text(mode="TRINARY"), {"mode": "trinary", "unknown": 1}),
    ("Y26-old-trinary", yaml_text(mode=None, trinary="true"), {"mode": "trinary"}),
    ("Y26-old-scale", yaml_text(mode=None, scale="true"), {"mode": "scale"}),
    ("Y26-no-mode", yaml_text(mode=None), {"mode": "trinary"}),
]


@pytest.mark.parametrize(("text", "expected"), named(READABLE))
def test_an_odd_value_with_a_plain_meaning_is_read(folder, info, text, expected):
    write_map(folder, text)
    assert info()[0].items() >= expected.items()


def test_missing_thresholds_and_negate_take_their_defaults_with_a_warning(folder, info):
    write_map(folder, yaml_text(negate=None, occupied_thresh=None, free_thresh=None))
    report, (warned,) = info()
    assert (report["negate"], report["occupied_thresh"], report["free_thresh"]) == (0, 0.65, 0.196)
    assert (report["occupied"], report["free"], report["unknown"]) == (2, 3, 1)
    assert "missing: negate, occupied_thresh, free_thresh (ROS requires them); assuming" in warned


@pytest.mark.parametrize(("changes", "place", "rule"), [
    ({"free_thresh": None, "occupied_thresh": "0.05"}, "free_thresh",
     "is missing and its default 0.196 exceeds occupied_thresh 0.05"),
    ({"free_thresh": "0.7", "occupied_thresh": None}, "occupied_thresh",
     "is missing and its default 0.65 is below free_thresh 0.7"),
])  # fmt: skip
def test_a_missing_threshold_needs_a_default_that_fits(folder, refused, changes, place, rule):
    write_map(folder, yaml_text(**changes))
    refused(["info", "m.yaml"], 3, f"m.yaml: {place}: {rule}", hint=f"write {place}")


# Darkness of the pixels: 1 twice, 0.196 once, 0.004 thrice; thresholds both 1: only nav2 lets
# free win. Grey 102 lies on a threshold of 0.6, which only nav2 includes.
@pytest.mark.parametrize("dialect", ["nav2", "humble", "ros1"])
def test_equal_thresholds_and_those_at_a_grey_level_go_by_the_dialect(folder, info, dialect):
    write_map(folder, yaml_text(occupied_thresh="1", free_thresh="1.0"))
    report, warned = info("--dialect", dialect)
    assert (report["occupied"], report["free"]) == ((0, 6) if dialect == "nav2" else (0, 4))
    assert any("free_thresh" in line for line in warned)
    write_map(folder, yaml_text(occupied_thresh="0.6"), b"P5\n3 2\n255\n" + bytes([102] * 6))
    report, _ = info("--dialect", dialect)
    assert (report["occupied"], report["unknown"]) == ((6, 0) if dialect == "nav2" else (0, 6))


@pytest.mark.parametrize(("image", "warns"), [
    ("~/maps/n.pgm", True), ("maps\\n.pgm", True), ("/elsewhere/of/another/machine/m.pgm", True),
    ("C:\\maps\\m.pgm", True), ("./maps/../maps/n.pgm", False), ("./lost/m.pgm", True),
    ("../lost/m.pgm", True), ("lost\\m.pgm", True), ("file:///elsewhere/%6d.pgm", True),
    ("file:maps/n.pgm", True), ("package://robot/maps/m.pgm", True),
])  # fmt: skip
def test_an_image_path_of_another_kind_is_found(folder, monkeypatch, accepted, image, warns):
    monkeypatch.setenv("HOME", str(folder))
    write_map(folder, yaml_text(image=image))
    (folder / "maps").mkdir()
    (folder / "maps" / "n.pgm").write_bytes(PGM)
    _, warned = accepted("convert", "m.yaml", "-o", "o.npz")
    assert cells_of("o.npz") == cells(DRAWING).tolist()
    assert any("image" in line for line in warned) == warns


@pytest.mark.parametrize("name", ["n" * 300, "C:\\\\" + "n" * 300, "~\\0", "a\\0b", "a\\nb"])
def test_an_image_path_that_no_file_can_have_is_refused(folder, refused, name):
    write_map(folder, yaml_text(image=f'"{name}"'))
    refused(["info", "m.yaml"], 4, "m.yaml", "image")


@pytest.mark.parametrize("name", ["2024-01-01", "12", "true"])
def test_an_image_named_like_another_kind_of_value_is_found(folder, info, name):
    write_map(folder, yaml_text(image=name))
    (folder / "m.pgm").rename(folder / name)
    assert info()[0]["image"] == name


def test_unknown_keys_are_kept_through_a_round_trip(folder, accepted):
    write_map(folder, yaml_text() + "building: hall\nfloors: [1, 2]\n")
    accepted("convert", "m.yaml", "-o", "o.yaml")
    assert {"building: hall", "floors: [1, 2]"} <= set((folder / "o.yaml").read_text().splitlines())


def test_a_clipped_shape_of_a_file_is_named(folder, accepted):
    shape = "shapes:\n- {type: circle, center: [99, -2], radius: 1, value: 1}\n"
    (folder / "z.yaml").write_text(shape)
    _, warned = accepted("edit", "circle", "m.yaml", "-o", "o.npz", "--file", "z.yaml")
    assert "z.yaml: shape 1 (line 2): circle" in warned[0]
