"""Every hard case at its small size. `make hard-cases` runs them in full and writes a page."""

from __future__ import annotations

import pytest
from case import HardCase, every_case, run_case

pytestmark = pytest.mark.usefixtures("small_pilot")


@pytest.mark.parametrize("case", every_case(), ids=lambda case: case.name)
def test_hard_case(case: HardCase) -> None:
    if case.slow:
        pytest.skip("runs in full only: make hard-cases")
    if case.needs:
        pytest.importorskip(case.needs)
    outcome = run_case(case, full=False)
    wrong = [f"{c.what}: {c.measured}, expected {c.expected}" for c in outcome.run.checks if not c.passed]
    problem = outcome.error or "; ".join(wrong) or ("" if outcome.run.checks else "nothing was compared")
    if case.limit:
        assert problem, f"{case.name} passes: it is no limit any more"
        pytest.xfail(case.limit)
    assert not problem, f"{case.name}: {problem}"
