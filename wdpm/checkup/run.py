"""What is wrong or risky in a scene, and what a render does about it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from os import PathLike, fsdecode
from pathlib import Path

import numpy as np

from wdpm.checkup.findings import Checkup, Finding, Level, sorted_findings
from wdpm.checkup.overlap import check_overlaps
from wdpm.checkup.part import Part
from wdpm.checkup.scene import check_camera, check_lights, check_materials, check_size
from wdpm.checkup.shapes import check_copies, check_normals, check_spikes, check_triangles
from wdpm.checkup.soup import make_soup
from wdpm.checkup.standing import looked_at, tell_of
from wdpm.checkup.surfaces import Solid, check_surface, rims
from wdpm.scenes.errors import SceneError
from wdpm.scenes.flat.dropped import degenerate_cause
from wdpm.scenes.load import load
from wdpm.scenes.model.checks import check_scene
from wdpm.scenes.model.scene import Scene

__all__ = ["Checkup", "Finding", "Level", "check"]


def check(
    scene: Scene | str | PathLike[str],
    *,
    defines: Mapping[str, str] | None = None,
    size: tuple[int, int] | None = None,
    lenient: bool = False,
) -> Checkup:
    """Look for what is wrong or risky in a scene, without rendering it.

    Args:
        scene: a scene, a file or the name of a built-in scene, as for `render`.
        defines: values of a Mitsuba file's `$name` parameters.
        size: width and height in pixels that replace the file's.
        lenient: as for `load`.

    Raises:
        SceneError: a file that cannot be read at all.
    """
    file = None
    if not isinstance(scene, Scene):
        name = fsdecode(scene) if isinstance(scene, str | PathLike) else None
        file = name if name is not None and Path(name).exists() else None
        scene = load(scene, defines=defines, size=size, lenient=lenient)
    findings = sorted_findings(_find(scene))
    return Checkup(scene.name, file, len(scene.meshes), sum(len(mesh.faces) for mesh in scene.meshes), findings)


def _find(scene: Scene) -> Iterator[Finding]:
    for note in scene.warnings:
        missing = "not found" in note
        does = "goes on with what is said" if missing else ""
        level = Level.WARNING if missing else Level.NOTE
        yield Finding(level, "missing-file" if missing else "loader", note, does, "bring the file" if missing else "")
    try:
        check_scene(scene)
    except SceneError as error:
        yield Finding(
            Level.ERROR, "refused", str(error), "refuses the scene", "mend it; nothing else is certain till then"
        )
    if not all(0 <= mesh.material < len(scene.materials) for mesh in scene.meshes):
        return
    scene, left_out = looked_at(scene)
    yield from tell_of(left_out)
    try:
        soup = make_soup(scene, left_out)
    except SceneError:
        return  # no triangles: told above
    cause = degenerate_cause(soup.positions)
    longest = soup.longest()
    median = float(np.median(longest[cause == 0])) if (cause == 0).any() else 0.0
    open_rims = rims(scene, soup, cause)
    solids: list[Solid] = []
    for number in range(len(scene.meshes)):
        part = Part(scene, soup, number)
        yield from check_triangles(part, cause, longest)
        yield from check_surface(part, cause, solids, open_rims)
        yield from check_normals(part, cause)
        yield from check_spikes(part, cause, longest, median)
    yield from check_copies(scene, soup, cause)
    yield from check_overlaps(scene, soup, cause)
    yield from check_size(scene, soup, cause)
    yield from check_materials(scene, soup, cause, solids)
    yield from check_lights(scene, soup, cause)
    yield from check_camera(scene, soup, cause, solids)
