"""What tests of properties share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from wdpm.cluster.plan import map_plans, photon_pilot


@pytest.fixture(scope="module")
def small_pilot() -> Iterator[None]:
    """A shorter pilot and fewer surface points: the same for all renders of a file, and quicker."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(photon_pilot, "PILOT_PATHS", 1 << 12)
        patch.setattr(map_plans, "POINTS_LEAST", 1 << 12)
        yield
