"""A small share of the gather fuzzer, and that it notices what it is for. `make fuzz` runs it at length."""

from __future__ import annotations

from dataclasses import replace

import fuzz_gather
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wdpm.kernels.photons.gather_settings import MAX_K


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_the_k_nearest_photons(seed: int) -> None:
    assert fuzz_gather.run_case(seed)[1] == []


@pytest.mark.parametrize("kind", ["one place", "lattice", "clusters", "volume"])
@pytest.mark.parametrize("k", [1, 50, MAX_K])
def test_a_full_buffer_loses_no_photon(kind: str, k: int) -> None:
    """Far more photons within the first radius than the buffer holds, at equal distances too."""
    case = fuzz_gather.case_of(np.random.default_rng(5), kind, 9000, k, 0.9, queries=12)
    assert fuzz_gather.judge(case, fuzz_gather.gather_all(case), fuzz_gather.expect(case)) == []


def test_another_photon_is_noticed() -> None:
    """One photon exchanged for another, one float of irradiance, one of the radius: each is a failure."""
    cases = map(fuzz_gather.make_case, range(100))
    case = next(case for case in cases if case.k == 50 and len(case.photons["id"]) > 500 and case.r_max > 0.2)
    expected = fuzz_gather.expect(case)
    found = fuzz_gather.gather_all(case)
    assert fuzz_gather.judge(case, found, expected) == []
    q = int(np.argmax(expected.count))
    assert expected.count[q] > 1
    ids = list(found.ids)
    ids[q] = ids[q].copy()
    ids[q][0] = -1
    assert [f.message for f in fuzz_gather.judge(case, replace(found, ids=ids), expected)] == [
        f"query {q}: another set of photons"
    ]
    radius = found.radius.copy()
    radius[q] = np.nextafter(radius[q], np.float32(np.inf))
    assert len(fuzz_gather.judge(case, replace(found, radius=radius), expected)) == 1
    brighter = found.irradiance.copy()
    brighter[q, 1] = np.nextafter(brighter[q, 1], np.float32(np.inf))
    assert len(fuzz_gather.judge(case, replace(found, irradiance=brighter), expected)) == 1
