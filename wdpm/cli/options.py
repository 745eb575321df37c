"""Options that several commands share. An option of the render settings is one row of SETTING_OPTIONS."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import Enum
from pathlib import Path
from typing import Any

from wdpm import values
from wdpm.cluster.plan.copies import Copies
from wdpm.cluster.render_settings import (
    EFFECTS_TO_LEAVE_OUT,
    MOST_SHADOW_RAYS,
    Indirect,
    Instancing,
    Integrator,
    RenderSettings,
    Routing,
)
from wdpm.devices import available_cores
from wdpm.images.view_transform import ViewTransform
from wdpm.rendering.compiling import Compiling
from wdpm.scenes.meshes.framing import Frame


@dataclass(frozen=True)
class SettingOption:
    """One option of the command line that sets the field of RenderSettings of the same name.

    Attributes:
        field: of RenderSettings; `light_samples` becomes `--light-samples`.
        group: heading in the help.
        text: help, without the default.
        parse: from text, or the enumeration of the choices; None makes it a flag.
        metavar: name of the value in the help.
        default: the default in words, where it is not simply the field's.
    """

    field: str
    group: str
    text: str
    parse: Callable[[str], Any] | type[Enum] | None = values.positive_count
    metavar: str = "N"
    default: str | None = None


_QUALITY = "image quality"
_MAPS = "maps that only some scenes call for"
_WORK = "how the work is done (changes no bit of the image)"
_APPROXIMATION = "approximation"

_ALGORITHMS = [each.algorithm for each in Integrator]
_ONE_SHADOW_RAY = [each.name for each in _ALGORITHMS if each.shadow_rays == 1]
_INTEGRATORS = ", or ".join(each.option_help for each in _ALGORITHMS)

SETTING_OPTIONS = (
    SettingOption("spp", _QUALITY, "samples a pixel", default="the scene's, or 16"),
    SettingOption("photons", _QUALITY, "photons to store in the global map", values.count),
    SettingOption("k", _QUALITY, "photons of a density estimate: the k nearest"),
    SettingOption(
        "radius",
        _QUALITY,
        "largest radius of a density estimate, in scene units",
        values.length,
        "LENGTH",
        default="from the scene",
    ),
    SettingOption("caustic_photons", _MAPS, "photons to store in the caustic map", values.count),
    SettingOption("caustic_k", _MAPS, "k of density estimates from the caustic map"),
    SettingOption(
        "caustic_radius",
        _MAPS,
        "largest radius of density estimates from the caustic map, in scene units",
        values.length,
        "LENGTH",
        default="from the scene",
    ),
    SettingOption("volume_photons", _MAPS, "photons to store in participating media", values.count),
    SettingOption(
        "volume_radius",
        _MAPS,
        "radius of the beam estimate in media: photons so near to a camera ray count, in scene units",
        values.length,
        "LENGTH",
        default="from the scene",
    ),
    SettingOption("volume_samples", _MAPS, "at most so many of a pixel's samples gather light in media"),
    SettingOption("integrator", _QUALITY, _INTEGRATORS, Integrator, "HOW"),
    SettingOption(
        "indirect",
        _QUALITY,
        "how indirect light on diffuse surfaces is estimated: map (from the photon map where it is seen), gather "
        "(final gathering: from the photon map one bounce later), cache (final gathering at some places, interpolated "
        "in between) or auto",
        Indirect,
        "HOW",
    ),
    SettingOption(
        "light_samples",
        _QUALITY,
        "shadow rays of a camera sample, from the first surface that it sees",
        values.count,
        default=f"{MOST_SHADOW_RAYS}, or 8 if a trial finds that better; 1 with one light that has no extent, and with "
        f"{', '.join(_ONE_SHADOW_RAY)}",
    ),
    SettingOption(
        "passes",
        _QUALITY,
        "render in so many passes and average them: each has its own photons, a share of the samples, and a smaller "
        "gather radius than the one before",
    ),
    SettingOption(
        "pass_samples",
        _QUALITY,
        "samples a pixel of each pass, separated by commas, where they are not spread evenly; --spp and --passes say "
        "how many they are together",
        values.counts,
        "N,N,...",
        default="spread evenly",
    ),
    SettingOption(
        "plan_samples",
        _QUALITY,
        "choose integrator, numbers of photons and the like for passes of so many samples a pixel, whatever they have",
        values.positive_count,
        "N",
        default="as many as a pass has on average",
    ),
    SettingOption(
        "adaptive",
        _QUALITY,
        "from the third pass on, take more samples where the passes before show more error, and fewer elsewhere; --spp "
        "stays the average",
        None,
    ),
    SettingOption(
        "max_depth",
        _QUALITY,
        "most edges of a light path: 1 is emitted light only, 2 direct light, ...",
        default="the scene's, or no limit",
    ),
    SettingOption("seed", _QUALITY, "seed of all random numbers", values.count),
    SettingOption(
        "bucket",
        _WORK,
        "width and height of a bucket (the tile that is one task), in pixels",
        values.count,
        default="32 to 128, by samples and slaves",
    ),
    SettingOption("all_effects", _WORK, "use kernels with all effects compiled in, not just the scene's", None),
    SettingOption(
        "strict",
        _WORK,
        "end with an error, which names the sample for --replay, the first time that a numerical guard drops light or "
        "makes an estimate coarser",
        None,
    ),
    SettingOption(
        "instances",
        _WORK,
        "shapes that a scene uses several times: keep (stored once), expand (copied) or auto (keep where that saves "
        "much memory)",
        Instancing,
        "HOW",
    ),
    SettingOption(
        "routing",
        _WORK,
        "how camera rays find their hit where the scene is cut into cells: forward (one cell hands a ray to the next) "
        "or merge (all cells on its way at once; the nearest hit counts)",
        Routing,
        "HOW",
    ),
    SettingOption(
        "without",
        _APPROXIMATION,
        f"leave effects out, separated by commas: {', '.join(EFFECTS_TO_LEAVE_OUT)}",
        values.names,
        "EFFECTS",
        default="none",
    ),
    SettingOption(
        "band",
        _APPROXIMATION,
        "width of the overlap band between cells, as a share of the gather radius; below 1 needs --inexact",
        values.length,
        "SHARE",
    ),
    SettingOption(
        "inexact", _APPROXIMATION, "allow --band below 1; the report counts the gathers that then miss photons", None
    ),
    SettingOption(
        "unsteered",
        _QUALITY,
        "do not steer photons towards what the camera sees, nor towards what makes caustics; all frames of a sequence "
        "are rendered so",
        None,
    ),
)


def add_setting_options(parser: argparse.ArgumentParser) -> None:
    """Add every row of SETTING_OPTIONS, under its heading."""
    defaults = {field.name: field.default for field in fields(RenderSettings)}
    groups: dict[str, Any] = {}
    for option in SETTING_OPTIONS:
        group = groups.setdefault(option.group, None) or parser.add_argument_group(option.group)
        groups[option.group] = group
        flag = "--" + option.field.replace("_", "-")
        if option.parse is None:
            group.add_argument(flag, action="store_true", default=None, help=option.text)
            continue
        default = option.default or _in_words(defaults[option.field])
        kind = option.parse if not isinstance(option.parse, type) else _enum_parser(option.parse)
        group.add_argument(flag, type=kind, metavar=option.metavar, help=f"{option.text} (default: {default})")


def chosen_settings(args: argparse.Namespace) -> dict[str, Any]:
    """The settings that were given on the command line, by field of RenderSettings."""
    given = {option.field: getattr(args, option.field) for option in SETTING_OPTIONS}
    return {name: value for name, value in given.items() if value is not None}


def add_scene_options(parser: argparse.ArgumentParser) -> None:
    """SCENE, -D, --size and --lenient."""
    parser.add_argument(
        "scene",
        metavar="SCENE",
        help="Mitsuba XML, glTF, OBJ, PLY, STL or OFF file, or a built-in scene: cornell-box, atrium:200k, forest",
    )
    group = parser.add_argument_group("scene")
    group.add_argument(
        "-D",
        dest="definitions",
        type=values.definition,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="set $NAME of a Mitsuba file; may be given several times",
    )
    group.add_argument("--size", type=values.size, metavar="WxH", help="size of the image (default: the scene's)")
    group.add_argument(
        "--scene-root",
        type=Path,
        metavar="DIR",
        help="folder that the scene and all files that it names must lie in (default: anywhere)",
    )
    group.add_argument(
        "--lenient",
        action="store_true",
        help="in a Mitsuba file, replace what is not supported by the nearest supported thing, or leave it out; the "
        "report lists each case (default: an error)",
    )


def add_view_options(parser: argparse.ArgumentParser) -> None:
    """--camera and --crop."""
    group = parser.add_argument_group("view")
    group.add_argument(
        "--camera",
        type=values.camera,
        metavar="NAME|FROM/AT[/UP][/FOV]",
        help="a camera of the scene by its name; or position, target and up vector (default: 0,1,0) as x,y,z and the "
        "horizontal field of view in degrees, like 0,1,5/0,1,0/40; write --camera=... if it begins with a minus "
        "(default: the scene's first)",
    )
    group.add_argument(
        "--frame",
        choices=[each.value for each in Frame],
        metavar="inside|outside",
        help="where to put the camera of a model that has none (default: inside if it is a closed room)",
    )
    parser.set_defaults(time=None)  # seconds of an animation: of a frame (frames.py)
    group.add_argument(
        "--crop",
        type=values.region,
        metavar="LEFT,TOP,RIGHT,BOTTOM",
        help="render only these pixels, by the camera samples that they have in the whole image (default: all, or the "
        "scene's crop)",
    )


def scene_words(args: argparse.Namespace) -> list[str]:
    """The words of a command line that name the same scene."""
    words = [args.scene]
    for name, value in args.definitions:
        words += ["-D", f"{name}={value}"]
    if args.size is not None:
        words += ["--size", f"{args.size[0]}x{args.size[1]}"]
    if args.lenient:
        words.append("--lenient")
    if args.camera is not None:
        name = args.camera if isinstance(args.camera, str) else values.viewpoint_text(args.camera)
        words.append(f"--camera={name}")
    if args.frame is not None:
        words += ["--frame", args.frame]
    if args.crop is not None:
        words += ["--crop", ",".join(map(str, args.crop))]
    return words


def add_output_options(parser: argparse.ArgumentParser) -> None:
    """-o, --report and --quiet."""
    group = parser.add_argument_group("output")
    group.add_argument(
        "-o",
        "--output",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="image to write: .exr (all layers, settings and report), .png, .hdr, .pfm or .npy; may be given several "
        "times (default: SCENE.exr in this folder)",
    )
    add_look_options(group)
    group.add_argument("--report", type=Path, metavar="FILE.json", help="also write the report as JSON")
    group.add_argument("-q", "--quiet", action="store_true", help="show neither progress nor report")


def add_look_options(group: argparse._ActionsContainer) -> None:
    """--exposure and --view-transform."""
    group.add_argument(
        "--exposure",
        type=values.exposure,
        metavar="EV|auto",
        help="exposure of PNG files and of the live view, in stops, or auto: from the image; EXR files keep radiance "
        "and only name it (default: the scene's, or 0)",
    )
    group.add_argument(
        "--view-transform",
        choices=[each.value for each in ViewTransform],
        metavar="NAME",
        help="tone mapping of PNG files and of the live view: standard (sRGB, clipped), filmic, agx (Blender's "
        "default) or neutral (Khronos PBR Neutral) (default: standard)",
    )


def look_words(args: argparse.Namespace) -> list[str]:
    """The words of a command line that show an image in the same way."""
    words = [] if args.exposure is None else [f"--exposure={args.exposure}"]
    return words if args.view_transform is None else [*words, "--view-transform", args.view_transform]


def add_cache_options(parser: argparse.ArgumentParser) -> None:
    """--save-cache and --load-cache."""
    group = parser.add_argument_group("irradiance cache (with --indirect cache)")
    group.add_argument(
        "--save-cache", type=Path, metavar="FILE", help="write the irradiance records of this view, for --load-cache"
    )
    group.add_argument(
        "--load-cache", type=Path, metavar="FILE", help="use the irradiance records of another view, and make none"
    )


def add_machine_options(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """--threads and --device; returns their group."""
    group = parser.add_argument_group("machine")
    group.add_argument(
        "--threads",
        type=values.positive_count,
        default=available_cores(),
        metavar="N",
        help="threads of each process that computes (default: all cores)",
    )
    group.add_argument(
        "--device", type=values.device, default="cpu", metavar="NAME", help="cpu or cuda:N (default: cpu)"
    )
    return group


def add_compile_option(group: argparse._ActionsContainer) -> None:
    """--compile, of what renders here."""
    group.add_argument(
        "--compile",
        type=_enum_parser(Compiling),
        default=Compiling.BESIDE,
        metavar="beside|first|no",
        help="when to compile kernels for just this scene's effects, if they are not in the cache. beside: render with "
        "kernels for all effects, which give the same bits, and compile in the background after the render, or beside "
        "passes that begin after 20 seconds; first: compile, then render; no: never (default: beside)",
    )


def add_copies_option(group: argparse._ActionsContainer) -> None:
    """Whether slaves hold copies of what others hold."""
    group.add_argument(
        "--copies",
        type=values.copies,
        default=Copies.AUTO,
        metavar="none|auto",
        help="auto: a slave with enough memory holds the whole scene, and no ray travels; none: the scene is cut among "
        "all slaves (default: auto)",
    )


def add_security_options(parser: argparse.ArgumentParser) -> None:
    """--keys or --insecure."""
    group = parser.add_argument_group("security (needed beyond this machine)")
    either = group.add_mutually_exclusive_group()
    either.add_argument("--keys", type=Path, metavar="FOLDER", help="this process's CURVE keys, made by wdpm keys")
    either.add_argument(
        "--insecure",
        action="store_true",
        help="neither encrypt nor authenticate: whoever reaches the port can take part",
    )


def _enum_parser(kind: type) -> Callable[[str], Any]:
    def parse(text: str) -> Any:
        names = [member.value for member in kind.__members__.values()]  # type: ignore[attr-defined]
        if text not in names:
            raise argparse.ArgumentTypeError(f"'{text}' must be one of {', '.join(names)}")
        return kind(text)

    return parse


def _in_words(default: object) -> str:
    if isinstance(default, Enum):
        return str(default.value)
    return f"{default:,}".replace(",000", "k") if isinstance(default, int) else f"{default}"
