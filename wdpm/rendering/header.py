"""What an image's header says of the scene beside settings and report: from where it is seen, and how it is shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wdpm.images.view_transform import LOOK, Look
from wdpm.scenes.model.scene import Camera, Scene


def camera_in_header(camera: Camera) -> dict[str, Any]:
    """A camera as JSON has it, in the scene's units; `to_world` by rows, its columns left, up, view and place."""
    where: dict[str, Any] = {"to_world": camera.to_world.tolist(), "width": camera.width, "height": camera.height}
    where |= {"orthographic": True} if camera.orthographic else {"fov": camera.fov_x}
    if camera.crop is not None:
        where |= {"crop": list(camera.crop), "full_size": list(camera.full_size or ())}
    return where


@dataclass(frozen=True)
class SceneHeader:
    """What is kept of a scene for the headers of its images.

    Attributes:
        camera: as `camera_in_header` has it.
        exposure: Scene.exposure.
    """

    camera: dict[str, Any]
    exposure: float | None

    def entries(self, beauty: NDArray[np.float32]) -> dict[str, Any]:
        """For an image; an exposure that the scene leaves open is found from its radiance."""
        return {"camera": self.camera, LOOK: Look(self.exposure).resolved(beauty).to_dict()}


def header_of(scene: Scene) -> SceneHeader:
    """Of a scene."""
    return SceneHeader(camera_in_header(scene.camera), scene.exposure)
