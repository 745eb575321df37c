"""Loads whatever the command line calls SCENE."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from wdpm.scenes.builtin.names import BUILT_IN_NAMES, load_built_in
from wdpm.scenes.errors import SceneError, did_you_mean
from wdpm.scenes.gltf.read import read_gltf
from wdpm.scenes.meshes.in_memory import Meshes, is_of_trimesh
from wdpm.scenes.meshes.stand_alone import read_stand_alone
from wdpm.scenes.mitsuba.read import read_mitsuba
from wdpm.scenes.model.checks import check_scene
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.scene_root import check_within, files_within

_EXTENSIONS = (".xml", ".gltf", ".glb", ".obj", ".ply", ".stl", ".off")


def load(
    source: str | Path | Meshes,
    *,
    defines: Mapping[str, str] | None = None,
    size: tuple[int, int] | None = None,
    root: Path | None = None,
    lenient: bool = False,
) -> Scene:
    """Loads a scene file or a built-in scene, and checks it.

    Args:
        source: a Mitsuba 3 XML file (0.6 names accepted), glTF 2.0 (.gltf, .glb), a bare mesh (.obj, .ply, .stl,
            .off: grey, lit and framed by default) or a built-in scene: "cornell-box", "atrium", "atrium:2M",
            "forest", "forest:10k"; or what trimesh has in memory: a mesh, several, or a scene (from_trimesh).
        defines: values of a Mitsuba file's `$name` parameters.
        size: width and height in pixels that replace the file's.
        root: folder that the scene's file and all files that it names must lie in; None for what `files_within` says.
        lenient: whether, in a Mitsuba file, the nearest known thing may stand in for what is not known; each such
            place is a warning of the scene. Other formats are always read so.

    Raises:
        SceneError: with file and line where known.
    """
    if size is not None and min(size) < 1:
        raise SceneError(f"the image size is {size[0]}x{size[1]}; both must be at least 1")
    if is_of_trimesh(source):
        from wdpm.scenes.meshes.from_trimesh import read_trimesh  # only for those who have imported trimesh

        _refuse_defines(defines, "trimesh")
        return check_scene(read_trimesh(source, size))
    if not isinstance(source, str | Path):
        raise SceneError(f"{type(source).__name__} is no scene: expected a file, a built-in scene or meshes of trimesh")
    file = find(source)
    if file is None:
        _refuse_defines(defines, source)
        return check_scene(load_built_in(str(source), size))
    with files_within(root):
        check_within(file)
        return check_scene(_read(file, source, defines, size, lenient=lenient), file)


def _read(
    file: Path,
    source: str | Path,
    defines: Mapping[str, str] | None,
    size: tuple[int, int] | None,
    *,
    lenient: bool,
) -> Scene:
    if file.suffix.lower() == ".xml":
        return read_mitsuba(file, defines or {}, size, lenient=lenient)
    _refuse_defines(defines, source)
    reader = read_gltf if file.suffix.lower() in (".gltf", ".glb") else read_stand_alone
    return reader(file, size)


def find(source: str | Path) -> Path | None:
    """The file of a scene, not read; None for a built-in one. Raises SceneError if it is neither."""
    if isinstance(source, str) and source.partition(":")[0] in BUILT_IN_NAMES:
        return None
    file = Path(source)
    if not file.exists():
        hint = did_you_mean(str(source), BUILT_IN_NAMES) or f" (built in: {', '.join(BUILT_IN_NAMES)})"
        raise SceneError(f"no such file, nor a built-in scene{hint}", file)
    if not file.is_file() or file.suffix.lower() not in _EXTENSIONS:
        raise SceneError(f"not a scene: expected a file with one of the extensions {' '.join(_EXTENSIONS)}", file)
    return file


def _refuse_defines(defines: Mapping[str, str] | None, source: str | Path) -> None:
    if defines:
        raise SceneError(f"-D {next(iter(defines))}=...: {source} has no parameters; only Mitsuba scenes have")
