"""What happens to a cluster, for those who keep a log of it or draw its curves.

Beside `progress` (a person who waits) and `display` (the image): these events say which slave did what, and when.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class ClusterEvent:
    """Something that happened.

    Attributes:
        name: what; docs/monitoring.md lists all names.
        facts: numbers and text by name, as that page lists them for the event.
    """

    name: str
    facts: Mapping[str, int | float | str] = field(default_factory=dict)


ClusterObserver = Callable[[ClusterEvent], None]
"""Is told what happens, on the thread that talks to the slaves: it must not take long, and must not raise."""
