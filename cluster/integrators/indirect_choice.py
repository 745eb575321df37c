"""Where indirect light comes from when nobody says: `--indirect auto`.

Final gathering with the irradiance cache is the least error for the time on surfaces that reflect nearly alike,
wherever light comes from, once there are samples enough to repay the gather rays of the records. Where light is
scattered by media, or most diffuse surfaces have bumps, sheen or Disney's base, which no record serves, the photon map
is read where the camera path meets it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from wdpm.cluster.integrators.indirect import Indirect
from wdpm.scenes.flat.flatten import FlatScene
from wdpm.scenes.flat.material_sides import even_sides, gathering_sides
from wdpm.scenes.flat.used_media import calls_for_media
from wdpm.scenes.flat.whole import area_by_material

if TYPE_CHECKING:
    from wdpm.cluster.integrators.integrator_settings import IntegratorSettings

SAMPLES_TO_REPAY = 1 << 17
"""Camera samples of a pass: below, the some hundred thousand gather rays of records cost more than they save."""

EVEN_SHARE = 0.5
"""Of the area that is diffuse at all."""


def choose_indirect(flat: FlatScene, settings: IntegratorSettings, *, wanted: bool) -> tuple[Indirect, str | None]:
    """What is chosen, and in words what and why; None where there was no choice.

    Args:
        wanted: whether there is a map of indirect light at all.
    """
    if settings.indirect is not Indirect.AUTO:
        return settings.indirect, None
    how, why = _choice(flat, settings, wanted)
    return how, None if why is None else f"indirect light: {how.value}, since {why}"


def _choice(flat: FlatScene, settings: IntegratorSettings, wanted: bool) -> tuple[Indirect, str | None]:
    if not wanted:
        return Indirect.MAP, None
    if calls_for_media(flat):
        return Indirect.MAP, "the scene has media"
    samples = flat.camera.width * flat.camera.height * settings.samples_of_pass
    if samples < SAMPLES_TO_REPAY:
        return Indirect.MAP, f"{samples:,} samples are too few to repay gathering (from {SAMPLES_TO_REPAY:,} on)"
    share = _even_share(flat)
    if share < EVEN_SHARE:
        return Indirect.MAP, f"{1 - share:.0%} of the diffuse surface has bumps, sheen or Disney's base"
    return Indirect.CACHE, f"{share:.0%} of the diffuse surface reflects light alike, wherever it comes from"


def _even_share(flat: FlatScene) -> float:
    """Of the area on which photons are stored, that which irradiance records serve."""
    from wdpm.kernels.launch import Launcher  # needs Warp, which a command that is only asked for help does not import
    from wdpm.kernels.rays.instance_areas import InstanceAreas
    from wdpm.kernels.rays.instances import upload_instances

    instances = flat.triangles.instances
    areas = InstanceAreas(instances, upload_instances(instances, "cpu"), Launcher())
    area = area_by_material(flat.triangles, len(flat.materials), areas.of)
    diffuse = area[gathering_sides(flat.materials) != 0].sum()
    served = area[even_sides(flat.materials) != 0].sum()
    return float(served / diffuse) if diffuse > 0 else 0.0
