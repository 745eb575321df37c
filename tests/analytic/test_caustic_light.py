"""The caustic map against closed forms: what a mirror or glass sends on is what falls on it, and a mirror's caustic is
the light of the lamp's mirror image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from furnaces import Array, box, quad, rendered, view
from reflectance import fresnel

from wdpm.cluster.render_settings import RenderSettings
from wdpm.cluster.task import PhotonTask
from wdpm.kernels.launch import Launcher
from wdpm.kernels.photons.deposits import CAUSTIC_MAP
from wdpm.progress import SilentProgress
from wdpm.rendering.prepare import prepare
from wdpm.scenes.model.bsdfs import Bsdf, Conductor, Dielectric, Diffuse, ThinDielectric
from wdpm.scenes.model.lights import Light, PointLight, SpotLight
from wdpm.scenes.model.scene import Camera, Material, Mesh, Scene
from wdpm.scenes.model.transforms import look_at

INTENSITY = (3.0, 2.0, 1.0)
LAMP = PointLight("lamp", (0.0, 0.0, 0.0), INTENSITY)
CAMERA = view((0, 0.5, -0.9), (0, -1, 0), 60, 8)


def scene_of(things: list[tuple[Mesh, Bsdf]], camera: Camera, *lights: Light, walls: float = 0.5) -> Scene:
    """Things in a closed room of half length 1, whose walls are diffuse."""
    meshes = [box((1, 1, 1), inside=True), *(replace(mesh, material=row + 1) for row, (mesh, _) in enumerate(things))]
    materials = [Material("walls", Diffuse((walls,) * 3)), *(Material("thing", bsdf) for _, bsdf in things)]
    return Scene("caustics", tuple(meshes), tuple(materials), lights, camera)


def caustic_flux(scene: Scene, **chosen: object) -> Array:
    """Flux of all photons of the caustic map, linear RGB [W]."""
    settings = RenderSettings(photons=2000, all_effects=True, **chosen)  # type: ignore[arg-type]
    prepared = prepare(scene, settings, 1, Launcher("cpu"), SilentProgress())
    worker, world = prepared.pilot, prepared.session.world
    assert worker is not None
    worker.adopt(world)
    worker.start(PhotonTask(0, 0, world.paths))
    photons = worker.cells[0].store.so_far()
    flux = photons["flux"][photons["map"] == CAUSTIC_MAP]
    assert len(flux) > 1000
    return np.asarray(flux.sum(axis=0, dtype=np.float64) / world.caustic_map.paths)


def square(half: float, distance: float) -> float:
    """Solid angle of a square of side 2 `half` seen from straight before its middle."""
    s = half * half
    return 4.0 * float(np.arctan(s / (distance * np.sqrt(2 * s + distance**2))))


MIRROR = quad((-0.3, -0.3, 0.5), (0, 0.6, 0), (0.6, 0, 0))  # faces -z
BLOCK = box((0.2, 0.2, 0.2), (0, 0, 0.7))  # its front at z = 0.5 hides the rest of it
DOWN = look_at((0, 0, 0), (0, 0, 1), (0, 1, 0))


@pytest.mark.parametrize(
    ("thing", "bsdf", "expected"),
    [
        (MIRROR, Conductor(), square(0.3, 0.5)),
        (MIRROR, Conductor(alpha_u=0.02, alpha_v=0.02), square(0.3, 0.5)),
        (MIRROR, Conductor(specular_reflectance=(0.5, 0.5, 0.5)), 0.5 * square(0.3, 0.5)),
        (BLOCK, Dielectric(1.5), square(0.2, 0.5)),
        (BLOCK, Dielectric(1.5, alpha_u=0.02, alpha_v=0.02), square(0.2, 0.5)),
    ],
    ids=["mirror", "rough mirror", "grey mirror", "glass", "rough glass"],
)
@pytest.mark.parametrize("light", [LAMP, SpotLight("spot", DOWN, INTENSITY, 60.0, 60.0)], ids=["point", "spot"])
def test_the_flux_of_caustics_is_what_falls_on_the_thing(
    thing: Mesh, bsdf: Bsdf, expected: float, light: Light
) -> None:
    flux = caustic_flux(scene_of([(thing, bsdf)], CAMERA, light), caustic_photons=100_000)
    # Photons are aimed at the bounding spheres, uniformly in solid angle; those that hit the thing, a third at least of
    # 100,000, are counted: sqrt(2 / 100,000) = 0.45 % if they were independent, Sobol's points do better. Roughness of
    # 0.02 loses nearly nothing.
    np.testing.assert_allclose(flux, np.array(INTENSITY) * expected, rtol=0.01)


def test_a_panes_straight_light_is_not_a_caustic_and_its_reflection_is() -> None:
    pane = quad((-0.3, -0.3, 0.5), (0, 0.6, 0), (0.6, 0, 0))
    flux = caustic_flux(scene_of([(pane, ThinDielectric(1.5))], CAMERA, LAMP), caustic_photons=100_000)
    x, y = np.meshgrid(*[(np.arange(400) + 0.5) / 400 * 0.6 - 0.3] * 2)
    distance2 = x**2 + y**2 + 0.25
    cosine = 0.5 / np.sqrt(distance2)
    once = fresnel(cosine, 1.5)
    reflected = (2 * once / (1 + once) * cosine / distance2).sum() * (0.6 / 400) ** 2
    np.testing.assert_allclose(flux, np.array(INTENSITY) * reflected, rtol=0.02)


def test_a_mirrors_caustic_is_the_light_of_the_lamps_image() -> None:
    """A mirror wall at x = 0.9; the floor about (0.3, -1, 0) sees the lamp's image at x = 1.8."""
    mirror = quad((0.9, -0.9, -0.9), (0, 0, 1.8), (0, 1.8, 0))  # faces -x
    albedo = 0.5
    looking = view((0.3, 0.2, -0.2), (0.3, -1, 0), 12, 12)
    scene = scene_of([(mirror, Conductor())], looking, LAMP, walls=albedo)
    image = rendered(scene, photons=1000, caustic_photons=200_000, caustic_k=100, spp=4, max_depth=3, all_effects=True)
    caustic = image.layers["caustic"].astype(np.float64)
    arm = np.array([1.8, 0.0, 0.0]) - np.array([0.3, -1.0, 0.0])
    distance2 = float(arm @ arm)
    exact = albedo / np.pi * np.array(INTENSITY) * arm[1] / np.sqrt(distance2) / distance2
    # The view is 0.25 across, where the light is linear to 1 %, and gathers reach about as far. They tell from some
    # 1,000 photons in all: 3 %, and four deviations.
    np.testing.assert_allclose(caustic.mean(axis=(0, 1)), exact, rtol=0.12)
