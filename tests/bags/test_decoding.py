"""Messages decoded by their definitions, compared with rosbags."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mapdeal.bags.messages import KNOWN, decoded, types_in

NUMBERS = {
    "bool": np.bool_, "int8": np.int8, "uint8": np.uint8, "int16": np.int16, "uint16": np.uint16,
    "int32": np.int32, "uint32": np.uint32, "int64": np.int64, "uint64": np.uint64,
    "float32": np.float32, "float64": np.float64,
}  # fmt: skip
PART = "pkg/Part"


@st.composite
def fields(draw, kinds):
    kinds = draw(st.lists(st.sampled_from(kinds), min_size=1, max_size=7))
    endings = st.sampled_from(["", "[]", "[3]", "[<=9]"])
    lines = [f"{kind}{draw(endings)} f{number}" for number, kind in enumerate(kinds)]
    lines.insert(draw(st.integers(0, len(lines))), "# [] f= comment\n\nuint8 CONSTANT=1 # one")
    return "\n".join(lines)


def value_of(draw, kind, store, lines):
    """Draw a value for a field, as rosbags takes it."""
    base, _, ending = kind.partition("[")
    count = {"": None, "3]": 3}.get(ending, draw(st.integers(0, 4)))
    if base in NUMBERS:
        raw = draw(st.binary(min_size=8 * (count or 1), max_size=8 * (count or 1)))
        numbers = np.frombuffer(raw, np.uint8).astype(np.int64).cumprod() % 251
        array = numbers[: 1 if count is None else count].astype(NUMBERS[base])
        return array[0].item() if count is None else array
    make = draw_text if base == "string" else message_of
    if count is None:
        return make(draw, base, store, lines)
    return [make(draw, base, store, lines) for _ in range(count)]


def draw_text(draw, _kind, _store, _lines):
    return draw(st.text("aB é", max_size=5))


def message_of(draw, kind, store, lines):
    of_kind = [line.split() for line in lines[kind].splitlines() if line[:1] not in ("", "#")]
    forms = {name: form for form, name, *_ in of_kind if "=" not in name}
    values = {name: value_of(draw, form, store, lines) for name, form in forms.items()}
    return store.types[kind.replace("/", "/msg/")](**values)


def check(decoded, expected):
    if isinstance(expected, np.ndarray):
        assert decoded.dtype == expected.dtype
        np.testing.assert_array_equal(decoded, expected)
    elif isinstance(expected, list):
        assert len(decoded) == len(expected)
        for pair in zip(decoded, expected, strict=True):
            check(*pair)
    elif hasattr(expected, "__dataclass_fields__"):
        names = [name for name in expected.__dataclass_fields__ if name.startswith("f")]
        assert list(vars(decoded)) == names
        for name in names:
            check(getattr(decoded, name), getattr(expected, name))
    else:
        assert (type(decoded), decoded) == (type(expected), expected)


def decoder_of(text, is_ros1, name="pkg/msg/Root"):
    return lambda data: decoded(data, name, types_in(name, text), is_ros1=is_ros1)


@given(st.data(), st.booleans())
def test_any_message_is_decoded_as_rosbags_does(data, is_ros1):
    basic = (*NUMBERS, "string")
    lines = {"pkg/Root": data.draw(fields((*basic, PART))), PART: data.draw(fields(basic))}
    text = f"{lines['pkg/Root']}\n{'=' * 80}\nMSG: {PART}\n{lines[PART]}\n"
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(text, "pkg/msg/Root"))
    message = message_of(data.draw, "pkg/Root", store, lines)
    raw = bytes((store.serialize_ros1 if is_ros1 else store.serialize_cdr)(message, "pkg/msg/Root"))
    decode = decoder_of(text, is_ros1=is_ros1)
    check(decode(raw), message)
    for damaged in (raw[: len(raw) // 2], raw + bytes(4)):
        with pytest.raises(Exception, match=r"."):  # as many kinds as there are reasons
            decode(damaged)


@pytest.mark.parametrize("name", [name for name in KNOWN if not name.startswith("nav2")])
def test_the_known_types_are_those_of_the_latest_ros_2(name):
    store = get_typestore(Stores.LATEST)
    (own,) = get_types_from_msg(KNOWN[name].replace("; ", "\n"), name).values()
    assert own[1] == store.fielddefs[name.replace("/", "/msg/")][1]


@pytest.mark.parametrize(("definition", "rule"), [
    ("float64", "invalid line 'float64'"),
    ("uint8[0] x", "fixed lengths of arrays must be 1 or more, and 10000 together at most"),
    ("uint8[10001] x", "fixed lengths of arrays must be 1 or more"),
    ("uint8 x\n" * 12_501, "100008 characters, the limit is 100000"),
    ("string[400000000] a", "fixed lengths of arrays"),
    ("a/B[] a\n===\nMSG: a/B\nuint8[0] a", "fixed lengths of arrays"),
    ("a/B[200] a\n===\nMSG: a/B\na/C[9000] a\n===\nMSG: a/C\nuint8[9000] a", "lengths of arrays"),
])  # fmt: skip
def test_definitions_that_make_no_sense_are_refused(definition, rule):
    with pytest.raises(ValueError, match=rule):
        types_in("pkg/msg/Root", definition)


@pytest.mark.parametrize("header", [b"", b"\0", b"\0\2\0\0", b"\0\7\0\0", b"\1\0\0\0"])
def test_other_encodings_than_cdr_are_refused(header):
    decode = decoder_of("uint32 x\n", is_ros1=False)
    assert decode(b"\0\0\0\0\0\0\0\1").x == decode(b"\0\1\0\0\1\0\0\0").x == 1
    with pytest.raises(ValueError, match="is in another encoding than CDR"):
        decode(header + b"\1\0\0\0" * bool(header[2:]))


def test_lengths_beyond_the_message_take_no_memory():
    decode = decoder_of("pkg/Empty[] x\n===\nMSG: pkg/Empty\n", is_ros1=True)
    assert len(decode(b"\2\0\0\0").x) == 2
    with pytest.raises(ValueError, match="x cannot have 4294967295 elements"):
        decode(b"\xff\xff\xff\xff")
