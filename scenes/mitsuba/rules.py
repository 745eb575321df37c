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
    "bsdf": {"pplastic": "plastic", "polarizer": "null", "circular": "null"},
    "film": {},
    "sensor": {},
}
"""Stand-ins by category and plugin, for lenient readers."""

NEAREST_BY_WORD: Final = {
    "bsdf": (
        *(("disney", "principled"), ("principled", "principled"), ("roughplastic", "roughplastic")),
        *(("plastic", "plastic"), ("roughdielectric", "roughdielectric"), ("dielectric", "dielectric")),
        *(("glass", "dielectric"), ("roughconductor", "roughconductor"), ("conductor", "conductor")),
        *(("metal", "roughconductor"), ("mirror", "conductor")),
    )
}
"""Stand-ins by a word in the plugin's name, where none stands for the whole name; the first word that is in it."""

RENAMED: Final = {"specular_transmission": "spec_trans", "specular_tint": "spec_tint", "subsurface": "flatness"}
"""Parameters of plugins that are not known, by what their stand-ins call them: Burley's names, and Mitsuba's."""

IMPLIED: Final = {
    "disneymetal": {"metallic": "1"},
    "disneyglass": {"spec_trans": "1"},
    "disneydiffuse": {"specular": "0"},
    "disneyclearcoat": {"base_color": "0", "specular": "0", "clearcoat": "1"},
    "disneysheen": {"specular": "0", "sheen": "1"},
}
"""What a plugin that is not known means without saying it, for its stand-in: parts of Burley's model by themselves."""

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
        words = NEAREST_BY_WORD.get(category, ())
        by_word = next((nearest for word, nearest in words if word in plugin_type.lower()), None)
        return NEAREST.get(category, {}).get(plugin_type) or by_word or STAND_IN.get(category)
