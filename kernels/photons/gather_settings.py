"""What gathers may be asked for."""

from __future__ import annotations

from wdpm.kernels.constants import MAX_GATHER_RADIUS, MIN_GATHER_RADIUS
from wdpm.kernels.limits import MAX_K
from wdpm.scenes.errors import SettingsError


def check_settings(k: int, r_max: float) -> None:
    """Raises SettingsError unless a gather can run with them."""
    if not 1 <= k <= MAX_K:
        raise SettingsError(f"k is {k}, expected 1 to {MAX_K} photons per gather: use more photons, not a larger k")
    if not MIN_GATHER_RADIUS <= r_max <= MAX_GATHER_RADIUS:
        raise SettingsError(
            f"the gather radius is {r_max:g} of half the scene's longest side; expected {MIN_GATHER_RADIUS:g} to "
            f"{MAX_GATHER_RADIUS:g}, whose squares float32 holds"
        )
