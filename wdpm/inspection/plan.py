"""What a render would do with a scene, for Python and notebooks: `wdpm.inspect`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wdpm.devices import check_count
from wdpm.inspection.inspect import Inspection, inspect
from wdpm.inspection.tables import inspection_parts
from wdpm.rendering.prepare import Source, sound_scene_of
from wdpm.report.html import html_of


@dataclass(frozen=True)
class Plan(Inspection):
    """An inspection that a notebook shows as the tables and lines of `wdpm inspect`."""

    def _repr_html_(self) -> str:
        return html_of(inspection_parts(self))


def plan_of(source: Source, slaves: int, chosen: Mapping[str, Any]) -> Plan:
    """Look at a scene as a render with chosen settings would, divided among slaves."""
    check_count("slaves", slaves)
    return Plan(**vars(inspect(sound_scene_of(source), slaves=slaves, **chosen)))
