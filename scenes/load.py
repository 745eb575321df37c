"""Loads whatever the command line calls SCENE.

Readers are imported for the files that they are for: a process that reads no glTF has no use for its reader.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import isfinite
from numbers import Integral, Real
from os import PathLike, fsdecode
from pathlib import Path
from typing import Any

import numpy as np

from wdpm.scenes.builtin.names import BUILT_IN_NAMES, load_built_in
from wdpm.scenes.errors import SceneError, did_you_mean
from wdpm.scenes.git_lfs import check_not_a_pointer
from wdpm.scenes.meshes.framing import Frame
from wdpm.scenes.meshes.in_memory import Meshes, is_of_trimesh
from wdpm.scenes.model.checks import check_scene
from wdpm.scenes.model.scene import Scene
from wdpm.scenes.model.viewpoint import named_camera
from wdpm.scenes.scene_root import check_within, files_within

GLTF = (".gltf", ".glb")
"""Extensions of files that may be animated."""

_EXTENSIONS = (".xml", ".gltf", ".glb", ".obj", ".ply", ".stl", ".off")


@np.errstate(over="ignore", invalid="ignore")  # check_scene says once, and in words, what is no number
def load(
    source: str | PathLike[str] | Meshes,
    *,
    defines: Mapping[str, str | float] | None = None,
    size: tuple[int, int] | None = None,
    root: str | PathLike[str] | None = None,
    lenient: bool = False,
    camera: str | None = None,
    frame: Frame | str | None = None,
    time: float | None = None,
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
        camera: name of the camera to look through, where a file has several; None for the first.
        frame: "inside" or "outside": from where a model without a camera is seen; None for from inside where it is a
            closed room.
        time: of a glTF file's animations, in seconds; None for the scene as it stands without.

    Raises:
        SceneError: with file and line where known.
    """
    if size is not None and not _is_pair(size):
        raise SceneError(f"the image size is {size!r}; expected width and height in pixels, like (512, 384)")
    if size is not None and min(size) < 1:
        raise SceneError(f"the image size is {size[0]}x{size[1]}; both must be at least 1")
    if root is not None and not isinstance(root, str | PathLike):
        raise SceneError(f"root is {root!r:.80}; expected the name of a folder")
    if time is not None and not (isinstance(time, Real) and isfinite(time)):
        raise SceneError(f"time is {time!r:.80}; expected seconds, like 1.5")
    size = None if size is None else (int(size[0]), int(size[1]))  # numpy's, too, which no report takes
    defines = _defined(defines or {})
    asked = _Asked(defines, size, lenient, camera, frame_of(frame), time)
    if is_of_trimesh(source):
        from wdpm.scenes.meshes.from_trimesh import read_trimesh  # only for those who have imported trimesh

        _refuse_defines(defines, "trimesh")
        if camera is not None or frame is not None or time is not None:
            raise SceneError("camera, frame and time are for files; set them in the scene of trimesh")
        return check_scene(read_trimesh(source, size))
    if not isinstance(source, str | PathLike):
        raise SceneError(f"{type(source).__name__} is no scene: expected a file, a built-in scene or meshes of trimesh")
    source = source if isinstance(source, str) else Path(fsdecode(source))
    file = find(source)
    if file is None:
        _refuse_defines(defines, source)
        _refuse_view(asked, source)
        return check_scene(load_built_in(str(source), size))
    with files_within(None if root is None else Path(fsdecode(root))):
        check_within(file)
        check_not_a_pointer(file)
        return check_scene(_read(file, source, asked), file)


@dataclass(frozen=True)
class _Asked:
    """What is asked of a reader, as `load` has it."""

    defines: Mapping[str, str]
    size: tuple[int, int] | None
    lenient: bool
    camera: str | None
    frame: Frame | None
    time: float | None


def frame_of(frame: Frame | str | None) -> Frame | None:
    """A frame by its name. Raises SceneError if there is none."""
    if frame is None or isinstance(frame, Frame):
        return frame
    try:
        return Frame(frame)
    except ValueError:
        raise SceneError(f"frame '{frame}': must be one of {', '.join(each.value for each in Frame)}") from None


def _defined(defines: Mapping[str, str | float]) -> dict[str, str]:
    """Values as a scene file has them. Raises SceneError for what no file could have."""
    if not isinstance(defines, Mapping):
        raise SceneError(f"defines is {defines!r:.80}; expected a dictionary of values by name, like {{'spp': 64}}")
    texts = {}
    for name, value in defines.items():
        if not isinstance(name, str) or not isinstance(value, str | Real):
            raise SceneError(f"defines has {name!r:.40}: {value!r:.40}; expected texts or numbers by name")
        texts[name] = str(value).lower() if isinstance(value, bool) else str(value)
    return texts


def _read(file: Path, source: str | Path, asked: _Asked) -> Scene:
    if file.suffix.lower() in GLTF:
        from wdpm.scenes.gltf.read import read_gltf

        _refuse_defines(asked.defines, source)
        return read_gltf(file, asked.size, camera=asked.camera, frame=asked.frame, time=asked.time)
    if asked.time is not None:
        raise SceneError("only glTF files are animated", file)
    if file.suffix.lower() == ".xml":
        from wdpm.scenes.mitsuba.read import read_mitsuba

        return read_mitsuba(
            file, asked.defines, asked.size, lenient=asked.lenient, camera=asked.camera, frame=asked.frame
        )
    _refuse_defines(asked.defines, source)
    if asked.camera is not None:
        named_camera(asked.camera, [], file)
    from wdpm.scenes.meshes.stand_alone import read_stand_alone

    return read_stand_alone(file, asked.size, asked.frame)


def _refuse_view(asked: _Asked, source: str | Path) -> None:
    """A built-in scene has one camera, which has no name, and stands still."""
    if asked.time is not None:
        raise SceneError(f"{source} is built in and stands still; only glTF files are animated")
    if asked.camera is not None or asked.frame is not None:
        what = "--camera NAME" if asked.camera is not None else "--frame"
        raise SceneError(f"{what}: {source} is built in and has one camera; give --camera FROM/AT to look elsewhere")


def find(source: str | PathLike[str]) -> Path | None:
    """The file of a scene, not read; None for a built-in one. Raises SceneError if it is neither."""
    if isinstance(source, str) and source.partition(":")[0] in BUILT_IN_NAMES:
        return None
    file = Path(source)
    if not file.exists():
        if str(source).partition(":")[0] in BUILT_IN_NAMES:
            raise SceneError("no such file; a built-in scene is asked for by a str of its name, not by a path", file)
        hint = did_you_mean(str(source), BUILT_IN_NAMES) or f" (built in: {', '.join(BUILT_IN_NAMES)})"
        raise SceneError(f"no such file, nor a built-in scene{hint}", file)
    if not file.is_file() or file.suffix.lower() not in _EXTENSIONS:
        raise SceneError(f"not a scene: expected a file with one of the extensions {' '.join(_EXTENSIONS)}", file)
    return file


def _is_pair(size: Any) -> bool:
    """Whether it is what a size is to be."""
    return isinstance(size, Iterable) and [isinstance(side, Integral) for side in size] == [True, True]


def _refuse_defines(defines: Mapping[str, str] | None, source: str | Path) -> None:
    if defines:
        raise SceneError(f"-D {next(iter(defines))}=...: {source} has no parameters; only Mitsuba scenes have")
