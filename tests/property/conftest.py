"""What tests of properties share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from wdpm.cluster.plan import plan


@pytest.fixture(scope="module")
def small_pilot() -> Iterator[None]:
    """A shorter pilot and fewer surface points: the same for all renders of a file, and quicker."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "PILOT_PATHS", 1 << 12)
        patch.setattr(plan, "POINTS_LEAST", 1 << 12)
        yield
