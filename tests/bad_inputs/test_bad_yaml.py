"""Bad YAML files (rows Y): what each is refused with, and what is read after all."""

import os
import re
import tracemalloc

import pytest
import yaml

from bad_maps import DRAWING, PGM, cells_of, write_map, yaml_text
from drawn import cells
from mapdeal import MalformedInputError
from mapdeal.files.yaml_text import YamlLimits, read_mapping

MALFORMED_FILES = [
    ("Y2-empty", b"", "no mapping in file"),
    ("Y2-comments-only", b"# a map\n\n# and no more\n", "no mapping in file"),
    ("Y3-list", b"- image: m.pgm\n- resolution: 0.05\n", "mapping"),
    ("Y3-scalar", b"m.pgm\n", "mapping"),
    ("Y4-two-documents", yaml_text() + "---\n" + yaml_text(), "line 8"),
    ("Y5-tab-indentation", "image: m.pgm\n\tresolution: 0.05\n", "line 2, column 1"),
    ("Y5-unclosed-bracket", yaml_text(origin="[1.5, -2.0, 0.4"), "line 5, column"),
    ("Y6-object-tag", yaml_text(image="!!python/object/apply:os.mkdir [hacked]"), "line 1"),
    ("Y6-object-tag-in-unknown-key", yaml_text(x="!!python/name:os.system ''"), "line 8"),
    ("Y6-integer-tag-on-nothing", yaml_text(x='!!int ""'), "x"),
    ("Y6-float-tag-on-nothing", yaml_text(x='!!float ""'), "x"),
    ("Y6-boolean-tag-on-a-word", yaml_text(x="!!bool maybe"), "x"),
    ("Y6-time-tag-on-a-word", yaml_text(x="!!timestamp noon"), "x"),
    ("Y7-nested-20000-deep", yaml_text(x="[" * 20000 + "]" * 20000), "nest"),
    ("Y7-nested-mappings", yaml_text(x="{a: " * 10_000 + "}" * 10_000), "nest"),
    (
        "Y7-alias-bomb",
        yaml_text(
            a="&a [x, x, x]",
            **{
                chr(98 + i): f"&{chr(98 + i)} [*{chr(97 + i)}" + f", *{chr(97 + i)}" * 9 + "]"
                for i in range(8)
            },
        ),
        "alias",
    ),
    ("Y7-one-alias", yaml_text(a="&a [x]", b="*a"), "aliases are not allowed"),
    (
        "Y7-merged-aliases",
        yaml_text(a0="&a0 {k: 1}")
        + "".join(
            f"a{i + 1}: &a{i + 1} {{<<: [{', '.join([f'*a{i}'] * 9)}], k{i}: 1}}\n"
            for i in range(12)
        ),
        "line 9: aliases are not allowed",
    ),
    ("Y7-many-ones", yaml_text(x="[" + "1, " * 20_000 + "1]"), "more than 1000 keys and values"),
    ("Y7-many-keys", "".join(f"k{i}: 1\n" for i in range(5000)), "more than 1000 keys and values"),
    ("Y7-sixty-four-kilobytes", yaml_text() + "# filler\n" * 7300, "65536 bytes"),
    ("Y7-two-megabytes", yaml_text() + "# filler\n" * 250_000, "bytes"),
    ("Y8-nul-byte", yaml_text().encode().replace(b"0.05", b"0.0\x005"), "not UTF-8"),
    ("Y8-utf-16", yaml_text().encode("utf-16"), "not UTF-8"),
    ("Y8-latin-1", yaml_text(image="caf\u00e9.pgm").encode("latin-1"), "not UTF-8"),
    ("Y9-duplicate-key", yaml_text() + "resolution: 0.1\n", "3 and 8"),
    ("Y10-all-missing", "negate: 0\n", "image, resolution, origin"),
    ("Y10-two-missing", yaml_text(image=None, origin=None), "image, origin"),
    ("Y31-pgm-named-yaml", PGM, "is an image (PNM), not a map"),
]


@pytest.mark.parametrize(
    ("text", "place"),
    [pytest.param(text, place, id=row) for row, text, place in MALFORMED_FILES],
)
def test_a_file_that_is_no_map_yaml_is_refused(folder, refused, text, place):
    write_map(folder, text)
    refused(["info", "m.yaml"], 3, "m.yaml", place)
    refused(["run", "m.yaml", "-o", "out"], 3, "m.yaml", place)


MALFORMED_VALUES = [
    ("Y13-decimal-comma", "resolution", "0,05", "'.'"),
    ("Y13-suffix", "resolution", "0.05f", "number"),
    ("Y13-unit", "resolution", "0.05 m", "number"),
    ("Y14-zero", "resolution", "0", ""),
    ("Y14-negative", "resolution", "-0.05", ""),
    ("Y14-nan", "resolution", "nan", ""),
    ("Y14-dotted-nan", "resolution", ".nan", ""),
    ("Y14-inf", "resolution", "inf", ""),
    ("Y14-dotted-inf", "resolution", ".inf", ""),
    ("Y14-overflow", "resolution", "1e400", ""),
    ("Y14-tiny", "resolution", "1e-300", ""),
    ("Y14-sexagesimal", "resolution", "1:30", ""),
    ("Y14-octal", "resolution", "010", ""),
    ("Y14-boolean", "resolution", "true", ""),
    ("Y14-list", "resolution", "[0.05]", ""),
    ("Y14-empty", "resolution", "", ""),
    ("Y17-two-numbers", "origin", "[1.5, -2.0]", ""),
    ("Y17-four-numbers", "origin", "[1.5, -2.0, 0.0, 0.4]", ""),
    ("Y17-no-commas", "origin", "[1.5 -2.0 0.4]", ""),
    ("Y17-null", "origin", "[1.5, null, 0.4]", ""),
    ("Y17-scalar", "origin", "1.5", ""),
    ("Y17-mapping", "origin", "{x: 1.5, y: -2.0, yaw: 0.4}", ""),
    ("Y17-nested", "origin", "[[1.5], -2.0, 0.4]", ""),
    ("Y17-overflow", "origin", "[1e400, -2.0, 0.4]", ""),
    ("Y18-minus-nan", "origin", "[1.5, -2.0, -nan]", "0"),
    ("Y18-nan", "origin", "[1.5, -2.0, nan]", "0"),
    ("Y22-free-above-occupied", "free_thresh", "0.7", ""),
    ("Y22-below-0", "free_thresh", "-0.1", ""),
    ("Y22-above-1", "occupied_thresh", "1.5", ""),
    ("Y22-nan", "occupied_thresh", "nan", ""),
    ("Y25-quoted-word", "negate", "'false'", ""),
    ("Y25-two", "negate", "2", ""),
    ("Y25-null", "negate", "null", ""),
    ("Y25-list", "negate", "[0]", ""),
    ("Y26-unknown-mode", "mode", "ternary", ""),
    ("Y26-mode-of-two-words", "mode", "[trinary]", ""),
    ("Y27-roslaunch-path", "image", "$(find maps)/m.pgm", "roslaunch"),
    ("Y27-empty", "image", "''", ""),
]


@pytest.mark.parametrize(
    ("key", "value", "hint"),
    [pytest.param(*case, id=row) for row, *case in MALFORMED_VALUES],
)
def test_a_value_that_is_not_allowed_is_refused(folder, refused, key, value, hint):
    write_map(folder, yaml_text(**{key: value}))
    refused(["convert", "m.yaml", "-o", "o.npz"], 3, "m.yaml", key, hint=hint)
    refused(["run", "m.yaml", "-o", "out"], 3, "m.yaml", key, hint=hint)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        pytest.param("missing.yaml", "No such file", id="Y1-missing"),
        pytest.param("maps.yaml", "directory", id="Y1-directory"),
        pytest.param("loop.yaml", "symbolic links", id="Y1-symlink-loop"),
        pytest.param("m.yaml/m.yaml", "Not a directory", id="Y1-below-a-file"),
        pytest.param("n" * 300 + ".yaml", "name too long", id="Y1-long-name"),
        pytest.param("missing.npz", "No such file", id="Y1-missing-npz"),
        pytest.param("n" * 300 + ".npz", "name too long", id="Y1-long-npz-name"),
        pytest.param("n" * 300 + ".pgm", "name too long", id="Y1-long-image-name"),
    ],
)
def test_a_map_that_cannot_be_opened_is_refused(folder, refused, name, text):
    (folder / "maps.yaml").mkdir()
    (folder / "loop.yaml").symlink_to("loop.yaml")
    refused(["info", name], 4, name[:20], text)
    refused(["run", name, "-o", "out"], 4, name[:20], text)


BOMBS = [
    pytest.param(yaml_text(x="[" * 20000 + "]" * 20000), id="Y7-nested-20000-deep"),
    pytest.param(yaml_text(x="[" + "1," * 30_000 + "]"), id="Y7-ones"),
    pytest.param(yaml_text(a="&a [x]", b="[" + "*a," * 20_000 + "]"), id="Y7-aliases"),
]


@pytest.fixture
def made_nodes(monkeypatch):
    """The values that PyYAML makes, which is what takes its time and memory."""
    made = []
    original = yaml.ScalarNode.__init__

    def counted(node, *arguments, **options):
        made.append(type(node))
        original(node, *arguments, **options)

    monkeypatch.setattr(yaml.ScalarNode, "__init__", counted)
    return made


@pytest.mark.parametrize("text", BOMBS)
def test_a_yaml_bomb_is_refused_at_once(folder, refused, made_nodes, text):
    write_map(folder, text)
    refused(["info", "m.yaml"], 3, "m.yaml")
    assert 0 < len(made_nodes) <= 1000


@pytest.mark.parametrize("text", BOMBS)
def test_a_yaml_bomb_in_a_folder_is_no_more_than_looked_into(folder, accepted, made_nodes, text):
    write_map(folder, text.replace("image", "picture"))
    write_map(folder / "good")
    accepted("run", ".", "-o", "out", "--no-images")
    assert 0 < len(made_nodes) <= 2100
    assert [path.name for path in (folder / "out").iterdir() if path.is_dir()] == ["good"]


LIMITS_OF_MAPS = YamlLimits(bytes=300, nodes=20, aliases=2)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        pytest.param("a: [1, 2, 3, 4, 5, 6, 7, 8]\nb: [1, 2, 3, 4, 5, 6, 7]\n", None,
                     id="20 nodes"),
        pytest.param("a: [1, 2, 3, 4, 5, 6, 7, 8]\nb: [1, 2, 3, 4, 5, 6, 7, 8]\n",
                     "line 2: more than 20 keys and values", id="21 nodes"),
        pytest.param("a: &a [1]\nb: *a\nc: *a\n", None, id="2 aliases"),
        pytest.param("a: &a [1]\nb: [*a, *a, *a]\n", "line 2: more than 2 aliases",
                     id="3 aliases"),
        pytest.param("a: &a [1, 1, 1, 1, 1]\nb: [*a, *a]\n", "line 2: more than 20 keys",
                     id="aliases count as what they stand for"),
        pytest.param("a: &a [1, [*a]]\n", "line 1: an alias within its own anchor", id="circle"),
        pytest.param("a: *b\n", "line 1, column 4: not valid YAML: found undefined alias",
                     id="unknown alias"),
        pytest.param("# " + "x" * 298 + "\n", "must not be larger than 300 bytes", id="bytes"),
    ],
)  # fmt: skip
def test_limits_are_the_callers_y7(tmp_path, text, place):
    path = tmp_path / "f.yaml"
    path.write_text(text)
    if place is None:
        assert read_mapping(path, LIMITS_OF_MAPS)
    else:
        with pytest.raises(MalformedInputError, match=re.escape(place)):
            read_mapping(path, LIMITS_OF_MAPS)


def test_a_yaml_file_of_200_megabytes_is_refused_before_it_is_read_y7(folder, refused):
    os.truncate(folder / "m.yaml", 200_000_000)
    tracemalloc.start()
    try:
        refused(["info", "m.yaml"], 3, "m.yaml", "bytes")
        assert tracemalloc.get_traced_memory()[1] < 16_000_000
    finally:
        tracemalloc.stop()


def test_a_pgm_passed_as_the_map_is_refused_with_its_yaml_named_y31(refused):
    refused(["info", "m.pgm"], 3, "m.pgm", hint="m.yaml")


READABLE = [
    ("Y8-byte-order-mark", b"\xef\xbb\xbf" + yaml_text().encode(), {"resolution": 0.05}),
    ("Y12-exponent-without-a-point", yaml_text(resolution="5e-2"), {"resolution": 0.05}),
    ("Y15-large-resolution", yaml_text(resolution="25.5"), {"resolution": 25.5}),
    ("Y15-small-resolution", yaml_text(resolution="0.0005"), {"resolution": 0.0005}),
    (
        "Y16-float32-noise",
        yaml_text(resolution="0.05000000074505806"),
        {"resolution": 0.05000000074505806},
    ),
    ("Y19-yaw", yaml_text(origin="[1.5, -2.0, 2.5]"), {"origin": [1.5, -2.0, 2.5]}),
    ("Y20-odd-origin", yaml_text(origin="[1.513, -2.0, 0.4]"), {"origin": [1.513, -2.0, 0.4]}),
    (
        "Y21-utm-origin",
        yaml_text(origin="[691608.25, 10000000.1, 0.4]"),
        {"origin": [691608.25, 10000000.1, 0.4]},
    ),
    ("Y23-205-below-free_thresh", yaml_text(free_thresh="0.25"), {"free": 4, "unknown": 0}),
    ("Y25-negate-no", yaml_text(negate="no"), {"negate": False, "occupied": 2, "free": 3}),
    ("Y25-negate-true", yaml_text(negate="true"), {"negate": True, "occupied": 4, "free": 2}),
    ("Y26-mode-in-capitals", yaml_text(mode="TRINARY"), {"mode": "trinary", "unknown": 1}),
    ("Y26-old-trinary", yaml_text(mode=None, trinary="true"), {"mode": "trinary"}),
    ("Y26-old-scale", yaml_text(mode=None, scale="true"), {"mode": "scale"}),
    ("Y26-no-mode", yaml_text(mode=None), {"mode": "trinary"}),
]


@pytest.mark.parametrize(
    ("text", "expected"), [pytest.param(*case, id=row) for row, *case in READABLE]
)
def test_an_odd_value_with_a_plain_meaning_is_read(folder, info, text, expected):
    write_map(folder, text)
    report, _ = info()
    assert {key: report[key] for key in expected} == expected


def test_missing_thresholds_and_negate_take_their_defaults_with_a_warning_y11(folder, info):
    write_map(folder, yaml_text(negate=None, occupied_thresh=None, free_thresh=None))
    report, warned = info()
    assert (report["negate"], report["occupied_thresh"], report["free_thresh"]) == (0, 0.65, 0.196)
    assert (report["occupied"], report["free"], report["unknown"]) == (2, 3, 1)
    assert len(warned) == 1
    assert "m.yaml" in warned[0]


@pytest.mark.parametrize(
    ("dialect", "expected"),
    [
        # Darkness of the pixels: 1 twice, 0.196 once, 0.004 thrice; thresholds both 1.
        pytest.param("nav2", (0, 6), id="Y22-nav2-lets-free-win"),
        pytest.param("humble", (0, 4), id="Y22-humble-is-strict"),
        pytest.param("ros1", (0, 4), id="Y22-ros1-is-strict"),
    ],
)
def test_equal_thresholds_are_read_as_the_dialect_does_with_a_warning(
    folder, info, dialect, expected
):
    write_map(folder, yaml_text(occupied_thresh="1", free_thresh="1.0"))
    report, warned = info("--dialect", dialect)
    assert (report["occupied"], report["free"]) == expected
    assert any("free_thresh" in line for line in warned)


@pytest.mark.parametrize(
    ("dialect", "expected"),
    [
        pytest.param("nav2", (6, 0), id="Y24-nav2-includes-the-threshold"),
        pytest.param("humble", (0, 6), id="Y24-humble-excludes-it"),
        pytest.param("ros1", (0, 6), id="Y24-ros1-excludes-it"),
    ],
)
def test_a_threshold_at_a_grey_level_is_read_as_the_dialect_does(folder, info, dialect, expected):
    write_map(folder, yaml_text(occupied_thresh="0.6"), b"P5\n3 2\n255\n" + bytes([102] * 6))
    report, _ = info("--dialect", dialect)
    assert (report["occupied"], report["unknown"]) == expected


@pytest.mark.parametrize(
    ("image", "warns"),
    [
        pytest.param("~/maps/n.pgm", True, id="Y27-home"),
        pytest.param("maps\\n.pgm", True, id="Y27-backslash"),
        pytest.param("/elsewhere/of/another/machine/m.pgm", True, id="Y27-absolute-and-missing"),
        pytest.param("C:\\maps\\m.pgm", True, id="Y27-windows"),
        pytest.param("./maps/../maps/n.pgm", False, id="Y27-dots"),
    ],
)
def test_an_image_path_of_another_kind_is_found(folder, monkeypatch, accepted, image, warns):
    monkeypatch.setenv("HOME", str(folder))
    write_map(folder, yaml_text(image=image))
    (folder / "maps").mkdir()
    (folder / "maps" / "n.pgm").write_bytes(PGM)
    _, warned = accepted("convert", "m.yaml", "-o", "o.npz")
    assert cells_of("o.npz") == cells(DRAWING).tolist()
    assert any("image" in line for line in warned) == warns


@pytest.mark.parametrize(
    "image",
    [
        pytest.param('"' + "n" * 300 + '.pgm"', id="Y27-long-name"),
        pytest.param('"C:\\\\' + "n" * 300 + '.pgm"', id="Y27-long-windows-name"),
        pytest.param('"~\\0"', id="Y27-nul-in-a-home"),
        pytest.param('"a\\0b.pgm"', id="Y27-nul"),
        pytest.param('"a\\nb.pgm"', id="Y27-newline"),
    ],
)
def test_an_image_path_that_no_file_can_have_is_refused(folder, refused, image):
    write_map(folder, yaml_text(image=image))
    refused(["info", "m.yaml"], 4, "m.yaml", "image")


@pytest.mark.skipif(not yaml.__with_libyaml__, reason="PyYAML comes without libyaml here")
def test_half_a_character_is_refused_y27(folder, refused):
    write_map(folder, yaml_text(image='"~\\ud800/m.pgm"'))
    refused(["info", "m.yaml"], 3, "m.yaml", "line 1, column 12")


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("2024-01-01", id="Y28-date"),
        pytest.param("12", id="Y28-number"),
        pytest.param("true", id="Y28-boolean"),
    ],
)
def test_an_image_named_like_another_kind_of_value_is_found(folder, info, name):
    write_map(folder, yaml_text(image=name))
    (folder / "m.pgm").rename(folder / name)
    report, _ = info()
    assert report["image"] == name


def test_unknown_keys_are_kept_through_a_round_trip_y30(folder, accepted):
    write_map(folder, yaml_text() + "building: hall\nfloors: [1, 2]\n")
    accepted("convert", "m.yaml", "-o", "o.yaml")
    written = (folder / "o.yaml").read_text().splitlines()
    assert "building: hall" in written
    assert "floors: [1, 2]" in written


def test_an_unknown_key_with_a_number_of_5000_digits_does_no_harm_y30(folder, command):
    write_map(folder, yaml_text() + f"serial: 0x{'f' * 5000}\n")
    code, _, err = command("convert", "m.yaml", "-o", "o.yaml")
    assert code in (0, 3)
    assert "Traceback" not in err
    assert (folder / "o.yaml").exists() == (code == 0)
