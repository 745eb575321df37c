"""Numbers in text have the bits that Python's float and int give them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm.scenes.meshes.text.numbers import find_words, floats, integers, padded

FORMATS = ("%.6f", "%.3f", "%g", "%r", "%.9g", "%+.4f", "%.15g", "%e", "%d", "%.1f", "%.8f", "%.12f", "%.0f")
SHORT = ("%.3f", "%.1f", "%+.2f")  # of which eight digits are enough, and each has a dot
numbers = st.floats(-1e9, 1e9) | st.floats(-1.0, 1.0) | st.floats(allow_nan=False, allow_infinity=False)


def read_floats(words: list[str]) -> np.ndarray:
    data = padded(" ".join(words).encode())
    found = find_words(data)
    assert found is not None
    assert len(found.begin) == len(words)
    return floats(data, found.begin, found.end)


@given(st.lists(st.tuples(st.sampled_from(FORMATS), numbers), min_size=1, max_size=40))
def test_decimals_have_the_bits_of_float(entries: list[tuple[str, float]]) -> None:
    words = [form % value for form, value in entries]
    assert read_floats(words).tobytes() == np.array([float(word) for word in words]).tobytes()


@given(st.lists(st.tuples(st.sampled_from(SHORT), st.floats(-99.0, 99.0)), min_size=1, max_size=40))
def test_short_decimals_have_the_bits_of_float(entries: list[tuple[str, float]]) -> None:
    words = [form % value for form, value in entries]
    assert read_floats(words).tobytes() == np.array([float(word) for word in words]).tobytes()


def test_the_corners_of_the_form() -> None:
    words = ["-0", "-0.0", ".5", "-.5", "5.", "00012.500", "1e-400", "+1", "1_0"]
    words += ["123456789012345", "1234567.12345678", "12345678", ".12345678"]
    for each in ([word] for word in words):
        assert read_floats(each).tobytes() == np.array([float(each[0])]).tobytes(), each
    assert read_floats(words).tobytes() == np.array([float(word) for word in words]).tobytes()


@given(st.lists(st.integers(-(2**63), 2**63 - 1) | st.integers(-(10**9), 10**9), min_size=1, max_size=40))
def test_whole_numbers(values: list[int]) -> None:
    data = padded("\n".join(str(value) for value in values).encode())
    found = find_words(data)
    assert found is not None
    assert integers(data, found.begin, found.end).tolist() == values


@pytest.mark.parametrize(
    "word", ["1.2.3", "-", ".", "+-1", "1a", "1:", "/", "1_", "0x1", "--1", "1-", "-.", "1e", "12345678a"]
)
def test_what_is_no_number_is_refused(word: str) -> None:
    with pytest.raises(ValueError, match="could not convert"):
        read_floats(["1", word, "2.5"])
    data = padded(f"1 {word} 2".encode())
    found = find_words(data)
    assert found is not None
    with pytest.raises(ValueError, match="invalid literal"):
        integers(data, found.begin, found.end)


def test_words_by_lines() -> None:
    found = find_words(padded(b"\n a  bc\t\r\n\n# d\ne"))
    assert found is not None
    assert found.counts.tolist() == [0, 2, 0, 2, 1]
    assert found.first.tolist() == [0, 0, 2, 2, 4]
    assert (found.end - found.begin).tolist() == [1, 2, 1, 1, 1]
    assert find_words(padded(b"a\x01b")) is None  # Python's split takes that for a letter
