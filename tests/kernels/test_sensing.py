import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from clouds import lzf_compressed
from mapdeal.kernels.sensing import decimals_in, lzf_expanded

pytestmark = pytest.mark.usefixtures("each_engine")


@given(
    data=st.lists(st.sampled_from([b"a", b"bc", b"abcabcabd", bytes(300), bytes(range(40))]))
    .map(b"".join)
    .filter(lambda text: len(text) < 1200)
)
def test_lzf_expands_to_what_was_compressed(data):
    packed = lzf_compressed(data)
    assert lzf_expanded(packed, len(data)).tobytes() == data
    assert lzf_expanded(packed, len(data) + 1) is None
    assert lzf_expanded(packed[:-1], len(data)) is None or not data


@given(data=st.binary(max_size=60), size=st.integers(0, 400))
@example(data=b"\x00a\x20\x05", size=4)  # looks back before its start
def test_lzf_of_anything_ends(data, size):
    found = lzf_expanded(data, size)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MAPDEAL_KERNELS", "scipy")
        twin = lzf_expanded(data, size)
    assert (found is None) == (twin is None)
    assert found is None or found.tobytes() == twin.tobytes()


DECIMALS = "-1.25 +.5 7. 1e-7 3.061617e-17 -0.0 v 12345678901234567890 1E5 nan 2e+22 4e-23 1e400"
DECIMALS += " 0.1234567890123456789 9007199254740993 5e+300"
WORDS = [st.sampled_from(DECIMALS.split()), st.decimals(-9999, 9999, places=6), st.floats()]


@given(st.lists(st.one_of(WORDS).map(str)))
def test_decimals_are_those_of_python(words):
    expected = [float(word.replace("v", "nan")) for word in words]
    assert np.array_equal(decimals_in(" \n".join(words).encode()), expected, equal_nan=True)
    text = "\t".join(word + "/7/v" for word in words).encode()
    assert np.array_equal(decimals_in(text, with_slashes=True), expected, equal_nan=True)
    for fault in ("1-2", "1.2.3", "1_0", "0x10", "e5", "-", "1e", "1/2", "/2", "x"):
        with pytest.raises(ValueError, match=r"number|convert"):
            decimals_in(" ".join([*words, fault]).encode())
