"""Values on the command line."""

from __future__ import annotations

import argparse
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wdpm import values


@pytest.mark.parametrize(
    ("text", "number"), [("0", 0), ("250k", 250_000), ("1M", 10**6), ("2.5M", 2_500_000), ("1.5k", 1500), ("1g", 10**9)]
)
def test_counts(text: str, number: int) -> None:
    assert values.count(text) == number


@given(st.integers(0, 10**7))
def test_counts_are_exact(thousandths: int) -> None:
    assert values.count(f"{thousandths // 1000}.{thousandths % 1000:03d}k") == thousandths


@pytest.mark.parametrize(
    ("parse", "text"),
    [
        *((values.count, text) for text in ("", "-1", "1.5", "1.0001k", "k", "1e6", "1 000", "12kk", "nan")),
        *((values.positive_count, text) for text in ("0", "0k")),
        *((values.size, text) for text in ("512", "0x512", "512x0", "-1x5", "5x5x5", "axb", "5.5x5")),
        *((values.memory, text) for text in ("8", "0G", "8.5G", "G", "8GB")),
        *((values.address, text) for text in ("localhost:1", "tcp://h", "tcp://h:0", "tcp://h:65536", "tcp://:1")),
        *((values.address, text) for text in ("udp://h:1", "tcp://a b:1", "tcp://h:1/x", "tcp://::1:5")),
        *((values.device, text) for text in ("gpu", "cuda:", "cuda:x", "")),
        *((values.definition, text) for text in ("a", "=1", "")),
        *((values.exposure, text) for text in ("", "bright", "1e9", "nan")),
        *((values.region, text) for text in ("1,2,3", "a,b,c,d", "-1,0,1,1")),
        (values.length, "wide"),
    ],
)
def test_bad_values_say_what_is_expected(parse: Any, text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"expected|must be|is not a number"):
        parse(text)


def test_good_values() -> None:
    assert values.size("640x480") == (640, 480)
    assert values.memory("8G") == 8 * 2**30
    assert values.address("tcp://[::1]:7117") == "tcp://[::1]:7117"
    assert values.address("tcp://render-1.example.org:7117") == "tcp://render-1.example.org:7117"
    assert values.definition("path=a=b") == ("path", "a=b")
    assert values.definition("empty=") == ("empty", "")
    assert values.device("cuda:1") == "cuda:1"
    assert (values.exposure("-1.5"), values.exposure("auto")) == (-1.5, "auto")
    assert values.region("1,2,30,40") == (1, 2, 30, 40)
