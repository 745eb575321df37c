"""Blender's camera: lens, sensor fit, shift, resolution, crop and depth of field."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from wdpm.blender.export.notes import Notes
from wdpm.scenes.errors import SceneError
from wdpm.scenes.model.scene import Camera, FilterKind, PixelFilter

_TURNED = np.diag([-1.0, 1.0, -1.0, 1.0])
"""Blender's camera looks along -z with +x to the right; ours along +z with +x to the left."""

_FILTER_SPREAD = 0.13
"""Standard deviation of Cycles' Blackman-Harris filter as a share of its width."""


def read_camera(depsgraph: Any, notes: Notes) -> Camera:
    """The camera of the evaluated scene.

    Raises:
        SceneError: there is none, or it is a panorama.
    """
    scene = depsgraph.scene
    if scene.camera is None:
        raise SceneError("the scene has no camera: add one (Add > Camera), or make one active (Ctrl-Numpad 0)")
    eye = scene.camera.evaluated_get(depsgraph)
    if eye.type != "CAMERA":
        raise SceneError(f'the scene\'s camera is "{eye.name}", an object of type {eye.type}; expected a camera')
    lens = eye.data
    if lens.type not in ("PERSP", "ORTHO"):
        raise SceneError(
            f'camera "{eye.name}": type {lens.type} is not supported; expected a perspective or orthographic camera'
        )
    render = scene.render
    width, height = image_size(render)
    if render.pixel_aspect_x != render.pixel_aspect_y:
        notes.add("output", "pixels that are not square are not supported: they are taken as square")
    matrix = np.array(eye.calc_matrix_camera(depsgraph, x=width, y=height, scale_x=1.0, scale_y=1.0), np.float64)
    to_world = np.array(eye.matrix_world.normalized(), np.float64) @ _TURNED
    camera = Camera(
        to_world,
        fov_x=90.0,
        width=width,
        height=height,
        near_clip=lens.clip_start,
        far_clip=lens.clip_end,
        filter=pixel_filter(render.filter_size),
    )
    if lens.type == "ORTHO":
        camera = _orthographic(camera, matrix)
    else:
        camera = _perspective(camera, matrix)
    return _cropped(_focused(camera, eye, notes), render)


def image_size(render: Any) -> tuple[int, int]:
    """Width and height of the whole image in pixels, resolution percentage included."""
    share = render.resolution_percentage
    return max(render.resolution_x * share // 100, 1), max(render.resolution_y * share // 100, 1)


def pixel_filter(width: float) -> PixelFilter:
    """Blender's "filter size" [pixels] as a gaussian as wide as Cycles' filter; next to none of it is a box."""
    if width <= 0.02:
        return PixelFilter()
    return PixelFilter(FilterKind.GAUSSIAN, width / 2.0, width * _FILTER_SPREAD)


def _perspective(camera: Camera, matrix: Any) -> Camera:
    """With the field of view and the shift of a projection matrix, OpenGL's."""
    fov = math.degrees(2.0 * math.atan(1.0 / matrix[0, 0]))
    return replace(camera, fov_x=fov, principal_point=(-matrix[0, 2] / 2.0, matrix[1, 2] / 2.0))


def _orthographic(camera: Camera, matrix: Any) -> Camera:
    to_world = camera.to_world.copy()
    to_world[:3, :2] /= matrix[0, 0]
    return replace(
        camera,
        to_world=to_world,
        orthographic=True,
        principal_point=(matrix[0, 3] / 2.0, -matrix[1, 3] / 2.0),
    )


def _focused(camera: Camera, eye: Any, notes: Notes) -> Camera:
    """With depth of field, if Blender's camera has it."""
    lens = eye.data
    if not lens.dof.use_dof:
        return camera
    if camera.orthographic:
        notes.add(f'camera "{eye.name}"', "depth of field of an orthographic camera is left out")
        return camera
    dof = lens.dof
    if dof.aperture_blades or dof.aperture_ratio != 1.0:
        notes.add(f'camera "{eye.name}"', "the aperture's blades and ratio are ignored: it is round")
    distance = dof.focus_distance
    if dof.focus_object is not None:
        way = np.array(dof.focus_object.matrix_world.translation, np.float64) - camera.to_world[:3, 3]
        distance = abs(float(way @ camera.to_world[:3, 2]))
    radius = lens.lens * 1e-3 / (2.0 * max(dof.aperture_fstop, 1e-6))
    return replace(camera, aperture_radius=radius, focus_distance=max(distance, 1e-5))


def _cropped(camera: Camera, render: Any) -> Camera:
    """Only Blender's render region (border), if there is one."""
    if not render.use_border:
        return camera
    left, bottom, width, height = render_region(render)
    if width < 1 or height < 1:
        raise SceneError("the render region is empty: draw a larger one (Ctrl-B), or clear it (Ctrl-Alt-B)")
    window = (left, camera.height - bottom - height, width, height)
    return replace(camera, crop=window, full_size=(camera.width, camera.height), width=width, height=height)


def render_region(render: Any) -> tuple[int, int, int, int]:
    """What Blender's engines render of the image: left, bottom (y runs upwards), width and height in pixels."""
    width, height = image_size(render)
    if not render.use_border:
        return 0, 0, width, height
    # Blender multiplies in float32 and cuts off.
    wide, high = np.float32(width), np.float32(height)
    left, right = int(np.float32(render.border_min_x) * wide), int(np.float32(render.border_max_x) * wide)
    bottom, top = int(np.float32(render.border_min_y) * high), int(np.float32(render.border_max_y) * high)
    return left, bottom, right - left, top - bottom
