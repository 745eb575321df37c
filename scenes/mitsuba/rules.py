"""What becomes of that which a file says and nobody here understands.

What cannot change the picture (integrators and samplers, which only say how it is computed) is a warning. What changes
it is an error; for a lenient reader it is a warning too, which says what the nearest known thing is that stands in.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from wdpm.scenes.errors import SceneError

HARMLESS: Final = {"integrator": "path", "sampler": "independent"}
"""Categories that say only how the picture is computed, and the plugins that are taken for those not known."""

NEAREST: Final = {
    "bsdf": {"pplastic": "plastic", "principledthin": "principled", "polarizer": "null", "circular": "null"},
    "film": {},
    "sensor": {},
}
"""Stand-ins by category and plugin, for lenient readers."""

STAND_IN: Final = {"bsdf": "diffuse", "film": "hdrfilm", "sensor": "perspective"}
"""What stands in for all others of a category. In the other categories, what is not known is left out."""

LENIENT: Final = "--lenient"


@dataclass
class Rules:
    """How strict a reader is, and what it has to say.

    Attributes:
        lenient: whether the nearest known thing may stand in for what is not known.
        warnings: grows by what a person should know.
    """

    lenient: bool = False
    warnings: list[str] = field(default_factory=list)

    def tell(self, line: int, message: str) -> None:
        """A warning."""
        self._add(f"line {line}: {message}")

    def refuse(self, error: SceneError, what: str, instead: str) -> None:
        """Raise an error; only warn if the reader is lenient.

        Args:
            what: is not understood.
            instead: what is done about it.
        """
        if not self.lenient:
            raise error
        self._add(f"line {error.line}: {what}: {instead} ({LENIENT})")

    def _add(self, warning: str) -> None:
        """Once, however many shapes refer to the place."""
        if warning not in self.warnings:
            self.warnings.append(warning)

    def stand_in(self, category: str, plugin_type: str) -> str | None:
        """The plugin that may stand in for one that is not known; None where it would be left out."""
        if category in HARMLESS:
            return HARMLESS[category]
        return NEAREST.get(category, {}).get(plugin_type) or STAND_IN.get(category)
