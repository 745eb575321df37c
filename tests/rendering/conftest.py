"""Renders of tests are small: a shorter pilot will do for all of them."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="module", autouse=True)
def _small_pilot(small_pilot: None) -> None:
    """Of all tests here."""
