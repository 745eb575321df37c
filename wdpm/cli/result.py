"""What the commands that make an image have in common: checks first, then load, render, write, report."""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from wdpm.cli.options import chosen_settings
from wdpm.cli.scene import viewed_scene_of
from wdpm.cluster.render_settings import RenderSettings
from wdpm.devices import available_cores
from wdpm.goal.render import OUTCOME
from wdpm.images.files import check_apart, check_output_path, check_place, write_bytes
from wdpm.images.image import Image
from wdpm.images.limits import check_memory
from wdpm.images.view_transform import Look, auto_exposure, look_of
from wdpm.kernels.camera.pixel_filter import is_signed
from wdpm.progress import Progress, make_progress
from wdpm.quiet import quiet_warp
from wdpm.rendering.cache_file import CacheNotWrittenError
from wdpm.rendering.scene_settings import settings_for
from wdpm.report import report
from wdpm.report.tables import print_report
from wdpm.scenes.errors import ImageError, NotWrittenError
from wdpm.scenes.model.scene import Scene
from wdpm.standard_streams import outlive_readers

if TYPE_CHECKING:
    from wdpm.cli.live import Viewers

Renderer = Callable[[Callable[[], Scene], RenderSettings, Progress], Image]


def render_and_write(
    args: argparse.Namespace, render: Renderer, view: Viewers | None = None, *, brief: bool = False
) -> int:
    """Load `args.scene`, have it rendered, write every output and the report; returns the exit code.

    Whatever can be found wrong before the render is found before it.

    Args:
        view: is told of progress; `render` shows it the image.
        brief: whether the report is not printed: of one frame of many.
    """
    outputs = _checked_outputs(args)
    chosen = chosen_settings(args)
    RenderSettings(**chosen)  # a value out of range is an error before the scene is read
    outlive_readers()
    quiet_warp()
    progress = make_progress(args.quiet)
    if view is not None:
        progress = view.following(progress)
    failed: list[ImageError] = []
    try:
        progress.start("load")
        began = time.perf_counter()
        scene = viewed_scene_of(args)
        load_s = time.perf_counter() - began
        if view is not None:
            view.show_as(look_of(args.exposure, args.view_transform, Look(scene.exposure)))
        check_memory(scene.camera)
        _check_room(outputs, scene)
        _refuse_negative(scene, outputs)
        settings = settings_for(scene, **chosen)
        handed_over = [scene]
        del scene  # a master lets go of what it has sent to its slaves, and so must we
        image = render(handed_over.pop, settings, progress)
    except CacheNotWrittenError as error:
        image = error.image
        failed.append(error)
    finally:
        progress.finish()
    image, account = _completed(image.looking(args.exposure, args.view_transform), load_s)
    failed += _write_all(image, account, outputs, args)
    if failed:
        raise ImageError("; ".join(map(str, failed)))
    if not (args.quiet or brief):
        print_report(account, Console())
    return 0


def first_output(args: argparse.Namespace) -> Path:
    """The first image that a command is to write."""
    given: list[Path] = args.output or [default_output(args.scene)]
    return given[0]


def default_output(scene: str) -> Path:
    """`scenes/hall.xml` gives hall.exr, `atrium:2M` gives atrium.exr, both in the working folder."""
    path = Path(scene)
    name = path.stem if path.suffix else path.name.partition(":")[0]
    return Path(f"{name or 'image'}.exr")  # `.` has no name; it is no scene either, which is for the loader to say


def _refuse_negative(scene: Scene, outputs: list[Path]) -> None:
    """Raise ImageError if an image is to go into a format that cannot hold what the pixel filter makes of it."""
    for path in outputs:
        if path.suffix.lower() == ".hdr" and is_signed(scene.camera.filter):
            raise ImageError(
                f"{path}: the scene's pixel filter has negative lobes, so pixels may be negative, which .hdr cannot "
                "hold; name an .exr or .pfm"
            )


def _checked_outputs(args: argparse.Namespace) -> list[Path]:
    """The images to write. Raises ImageError if one of them, the report or the irradiance records cannot be written."""
    outputs = [check_output_path(path) for path in args.output or [default_output(args.scene)]]
    if args.report is not None:
        check_output_path(args.report, (".json",))
    if args.save_cache is not None:
        check_place(args.save_cache)
    check_apart(output_paths(args))
    return outputs


def output_paths(args: argparse.Namespace) -> list[tuple[str, Path | None]]:
    """What a command writes and reads, as `check_apart` takes it: a file that holds two things has lost one."""
    outputs = args.output or [default_output(args.scene)]
    caches = [("irradiance records", path) for path in (args.save_cache, args.load_cache)]
    read = [("the scene", Path(args.scene)), ("the image to compare with", args.view_beside)]
    return [*(("the image", path) for path in outputs), ("the report", args.report), *caches, *read]


def _completed(image: Image, load_s: float) -> tuple[Image, report.Report]:
    """An image and its report with what the render could not know: the time of loading, and what came of a goal."""
    account = report.from_dict(image.metadata["report"])
    account = replace(account, phases={"load": load_s, **account.phases}, asked=image.metadata.get(OUTCOME))
    return replace(image, metadata={**image.metadata, "report": account.to_dict()}), account


def _kept_elsewhere(image: Image, path: Path, error: ImageError) -> ImageError:
    """Keep an image that its own place has no room for, or no more; returns an error that says where it is.

    What no file takes (pixels that are NaN) is not tried again.
    """
    if not isinstance(error, NotWrittenError):
        return error
    try:
        folder = Path(tempfile.mkdtemp(prefix="wdpm-"))
    except OSError:  # no room there either, or it has gone
        return error
    kept = folder / f"{path.stem}.exr"
    try:
        image.save(kept)
    except ImageError:
        folder.rmdir()
        return error
    return ImageError(f"{error}; the image is kept in {kept}")


def _check_room(outputs: list[Path], scene: Scene) -> None:
    """Raise ImageError before the render if the place of an image has not even room for one layer of it."""
    least = 3 * scene.camera.width * scene.camera.height  # a byte a channel: formats compress, but hardly better
    for path in outputs:
        free = shutil.disk_usage(path.parent).free
        if free < least:
            raise ImageError(f"{path}: {path.parent} has {free} bytes left; the image takes more than {least}")


FAR_OFF_STOPS = 1.5
"""Between a picture's exposure and what `auto` finds, from which on a person is told."""


def _exposed(image: Image, path: Path) -> str:
    """How a picture is exposed, where that is not simply as it is, or makes it hard to see."""
    if path.suffix.lower() != ".png":
        return ""
    stops, found = image.look.exposure or 0.0, auto_exposure(image.pixels)
    if abs(stops - found) > FAR_OFF_STOPS:
        how = "dark" if found > stops else "bright"
        return f" at {stops:+g} stops: it is {how}; --exposure auto would take {found:+g}"
    return f" at {stops:+g} stops" if stops else ""


def _write_all(image: Image, account: report.Report, outputs: list[Path], args: argparse.Namespace) -> list[ImageError]:
    """Write every output, even when one fails: a PNG that cannot be written must not cost the EXR.

    Returns:
        What went wrong.
    """
    errors: list[ImageError] = []
    for path in outputs:
        try:
            image.save(path, threads=getattr(args, "threads", None) or available_cores())
        except ImageError as error:
            errors.append(_kept_elsewhere(image, path, error))
            continue
        if not args.quiet:
            print(f"wrote {path}{_exposed(image, path)}")
    if args.report is not None:
        try:
            write_bytes(account.to_json().encode(), args.report)
        except ImageError as error:
            errors.append(error)
    return errors
