"""Sequences: frames of an animation, or numbered scenes, rendered one after the other by the same processes.

Each frame has the bits that it has when it is rendered alone. Where no more than the camera moves, geometry, photons
and maps stay from frame to frame.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wdpm import values
from wdpm.scenes.errors import GuardError, ImageError, JournalInUseError, SceneError, SettingsError, WdpmError
from wdpm.scenes.load import GLTF, find

if TYPE_CHECKING:
    from wdpm.rendering.backend import Backend
    from wdpm.scenes.model.scene import Scene

_NUMBER = re.compile(r"%0?(\d{0,2})d")
"""Where the name of a file has the frame's number: %d, or %04d with zeros."""

_DIGITS = 4


def add_frame_options(parser: argparse.ArgumentParser) -> None:
    """--frames and --fps."""
    group = parser.add_argument_group("sequence")
    group.add_argument(
        "--frames",
        type=values.frames,
        metavar="A..B",
        help="render these frames of an animated glTF file, or of numbered scenes named like scene.%%04d.xml, to "
        "IMAGE.0001.exr and so on: 1..24, 1..24..2 (every other one) or 7; --resume skips frames whose files exist, "
        "unless --keep-passes kept their passes and more are asked for",
    )
    group.add_argument(
        "--fps",
        type=values.rate,
        metavar="N",
        help="frames per second of an animated glTF file: frame n is at n/N seconds (default: 24)",
    )


def asks_for_frames(args: argparse.Namespace) -> bool:
    """Whether a sequence is asked for. Raises SettingsError for options that do not go with one, or only with one."""
    if args.frames is None:
        if args.fps is not None:
            raise SettingsError("--fps says how fast an animation goes: give --frames A..B, too")
        if _NUMBER.search(args.scene) and not Path(args.scene).exists():
            raise SettingsError(f"{args.scene} names numbered scenes: give --frames A..B, too")
        return False
    for name in ("until_error", "metric", "time_budget", "replay", "save_cache", "journal"):
        if getattr(args, name, None) is not None:
            raise SettingsError(f"--{name.replace('_', '-')} is for one image; leave it or --frames out")
    numbered = _is_numbered(args)
    if not numbered and Path(args.scene).suffix.lower() not in GLTF:
        raise SettingsError(
            f"--frames: {args.scene} does not move: name an animated glTF file, or numbered scenes like scene.%04d.xml"
        )
    if numbered and args.fps is not None:
        raise SettingsError("--fps is for animated glTF files; numbered scenes have no time")
    return True


def render_frames(args: argparse.Namespace, make_backend: Callable[[], Backend]) -> int:
    """Render and write every frame; returns the exit code. A frame that fails does not keep the others from coming.

    Args:
        make_backend: makes what renders all of them.
    """
    from wdpm.cli.live import shown

    frames = [(number, _frame(args, number)) for number in args.frames]
    for number, frame in frames:
        with _named(number):
            find(frame.scene)
    failed = []
    exposure = _Exposure(args)
    with shown(args) as view, make_backend() as backend:
        backend.display, backend.keeps_scene = view, True
        for place, (number, frame) in enumerate(frames, 1):
            try:
                if args.resume and all(map(_is_there, _outputs(frame))) and not _lacks_passes(frame):
                    exposure.read(_outputs(frame))
                    _tell(args, f"frame {number}: is there")
                    continue
                _tell(args, f"frame {number} ({place} of {len(frames)})")
                _render(frame, backend, view, exposure)
            except (GuardError, ImageError, JournalInUseError, SceneError) as error:  # others end all
                failed.append(str(number))
                print(f"wdpm: error: frame {number}: {error}", file=sys.stderr)
    if failed:
        raise SettingsError(f"{len(failed)} of {len(frames)} frames failed: {', '.join(failed)}")
    return 0


def _is_there(path: Path) -> bool:
    """Whether there is a file with something in it: an empty one holds a place, or a machine that crashed left it."""
    return path.is_file() and path.stat().st_size > 0


def _lacks_passes(frame: argparse.Namespace) -> bool:
    """Whether passes of a frame that is there were kept to add more, and more are asked for."""
    from wdpm.cli.journals import places_of
    from wdpm.cli.result import first_output
    from wdpm.rendering.pass_journal import read_journal

    kept = places_of(first_output(frame), None).passes
    return kept.exists() and len(read_journal(kept).plans) < (frame.passes or 1)


def _render(frame: argparse.Namespace, backend: Backend, view: Any, exposure: _Exposure) -> None:
    """Render and write one frame."""
    from wdpm.cli.journals import journals, places_of
    from wdpm.cli.result import first_output, render_and_write
    from wdpm.rendering.cache_file import CacheFiles
    from wdpm.rendering.passes import render_in_passes

    output = first_output(frame)
    places = places_of(output, None)
    frame.resume = frame.resume and (places.passes.exists() or places.log.exists())
    frame.exposure = exposure.given
    with journals(frame, output) as journal:

        def render(source: Callable[[], Scene], settings: Any, progress: Any) -> Any:
            cache = CacheFiles(None, frame.load_cache)
            noted = exposure.noting(source)
            image = render_in_passes(noted, backend, settings, progress=progress, cache=cache, **journal)
            exposure.settle(image)
            return image

        render_and_write(frame, render, view, brief=True)


class _Exposure:
    """What frames are shown with: where it is to be found from the picture, the first of them tells for all."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.given: float | str | None = args.exposure
        self._open = args.exposure == "auto"
        self._of_all = self._open or not _is_numbered(args)  # numbered scenes each say their own

    def noting(self, source: Callable[[], Scene]) -> Callable[[], Scene]:
        """The same source of a scene, whose exposure is looked at as it passes."""

        def take() -> Scene:
            scene = source()
            self._open = self._open or (self.given is None and scene.exposure is None)
            return scene

        return take

    def settle(self, image: Any) -> None:
        """Keep what the first image was found to need."""
        if self._open:
            self.given, self._open = image.looking(self.given).look.exposure, False

    def read(self, outputs: list[Path]) -> None:
        """The same from a frame that is there already."""
        from wdpm.images.files import look_in_file

        for path in outputs if self._of_all and self.given in (None, "auto") else ():
            look = look_in_file(path)
            if look is not None:
                self.given, self._open = look.exposure, False


def _frame(args: argparse.Namespace, number: int) -> argparse.Namespace:
    """What the command line says of one frame."""
    from wdpm.cli.result import default_output

    frame = argparse.Namespace(**vars(args))
    if args.integrator is None or args.integrator.algorithm.shoots_photons:
        frame.unsteered = True  # or photons would be others with each frame's camera, and flicker
    frame.output = [_numbered(path, number) for path in args.output or [default_output(args.scene)]]
    frame.report = None if args.report is None else _numbered(args.report, number)
    if _is_numbered(args):
        frame.scene = str(_numbered(Path(args.scene), number))
    else:
        frame.time = number / (args.fps or 24.0)
    return frame


def _is_numbered(args: argparse.Namespace) -> bool:
    """Whether SCENE names numbered scenes."""
    return _NUMBER.search(Path(args.scene).name) is not None


def _numbered(path: Path, number: int) -> Path:
    """`x.%02d.exr` to x.07.exr, and x.exr to x.0007.exr."""
    if _NUMBER.search(path.name):
        return path.with_name(_NUMBER.sub(lambda found: f"{number:0{int(found[1] or 1)}d}", path.name))
    return path.with_name(f"{path.stem}.{number:0{_DIGITS}d}{path.suffix}")


def _outputs(frame: argparse.Namespace) -> list[Path]:
    """All files that a frame makes."""
    return [*frame.output, *([] if frame.report is None else [frame.report])]


def _tell(args: argparse.Namespace, line: str) -> None:
    if not args.quiet:
        print(line, flush=True)


@contextmanager
def _named(number: int) -> Iterator[None]:
    """Have errors say of which frame they are."""
    try:
        yield
    except WdpmError as error:
        raise type(error)(f"frame {number}: {error}") from None
