"""Renders the pictures of gallery.md, measures their times and writes the page: `make gallery`.

`python docs/make_gallery.py caustic water` renders these two alone, and keeps the others; without names all
are rendered, which takes two idle cores a quarter of an hour. Kernels are compiled before a picture's time is taken.
"""

from __future__ import annotations

import json
import resource
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
from numpy.typing import NDArray

from wdpm.images.channels import encode_srgb8
from wdpm.images.exr import read_exr

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
OUT = ROOT / "out" / "gallery"
PICTURES = DOCS / "pictures" / "gallery"
TIMES = DOCS / "gallery" / "times.json"
PAGE = DOCS / "gallery.md"
LARGEST = 55_000
"""Bytes of a picture."""

QUICK = ["--size", "96x96", "--photons", "20k", "--caustic-photons", "20k"]
"""What makes a command one that compiles the same kernels, and renders little. (Samples decide about the cache.)"""


@dataclass(frozen=True)
class Picture:
    """One picture.

    Attributes:
        name: of its files.
        title: heading on the page.
        text: what is to be seen, in Markdown.
        command: what renders it, without the output.
        brighter: factor from the image to the picture, where it is dim.
        layers: shown side by side in place of the image.
    """

    name: str
    title: str
    text: str
    command: str
    brighter: float = 1.0
    layers: tuple[str, ...] = ()


GALLERY = (
    Picture(
        "cornell-box",
        "Cornell box",
        "The box as it was measured at Cornell University: one lamp, diffuse walls, and their colours on each other. "
        "Indirect light comes by [final gathering](final-gathering.md) with an irradiance cache, which is what `auto` "
        "picks here.",
        "wdpm render cornell-box --size 360x360 --spp 64 --photons 1M",
        brighter=1.8,
    ),
    Picture(
        "caustic",
        "Caustics",
        "Light that a ball of glass focuses on the floor, and the curve with a cusp inside a ring of gold. Both are "
        "looked up in a [caustic map](effects.md#the-maps), whose photons are aimed at what focuses.",
        "wdpm render docs/gallery/caustic.xml --spp 64 --caustic-photons 1M",
    ),
    Picture(
        "layers",
        "The same, by layers",
        "An EXR file holds the light by the way that it came: direct light, light off diffuse surfaces, caustics. "
        "The others are in the [reference](reference/layers.md).",
        "wdpm render docs/gallery/caustic.xml --spp 64 --caustic-photons 1M",
        layers=("direct", "indirect", "caustic"),
    ),
    Picture(
        "water",
        "Water under the sun",
        "What the ripples of a pool do to the sun's light. A path tracer hardly ever finds this light: the sun is a "
        "direction without an extent, and no path from the camera meets it. Eight [passes](passes.md), each with "
        "photons of its own and a narrower radius.",
        "wdpm render docs/gallery/water.xml --spp 32 --passes 8 --caustic-photons 500k",
    ),
    Picture(
        "glass",
        "Glass",
        "From the left: clear, rough, coloured by a medium inside that absorbs, and a bubble, which is a thin skin.",
        "wdpm render docs/gallery/glass.xml --spp 16",
    ),
    Picture(
        "metals",
        "Metals under half a sky",
        "Gold as a mirror, copper and aluminium with microfacets, brushed chromium. The sky is the model of Hosek and "
        "Wilkie, with its sun; here its zenith is behind the camera, and the dark rims are where it ends.",
        "wdpm render docs/gallery/metals.xml --spp 16",
    ),
    Picture(
        "principled",
        "One material for many looks",
        "`principled`: matt, glossy, metallic, varnished, velvet.",
        "wdpm render docs/gallery/principled.xml --spp 16",
    ),
    Picture(
        "fog",
        "Fog",
        "Two spots in a homogeneous medium, each with a ball in its beam. What the fog scatters is gathered along "
        "camera rays, from a volume map.",
        "wdpm render docs/gallery/fog.xml --spp 16 --volume-samples 8",
    ),
    Picture(
        "lens",
        "Depth of field",
        "A lens with an aperture, focused on the third ball.",
        "wdpm render docs/gallery/lens.xml --spp 32",
    ),
    Picture(
        "lattice",
        "A lamp in a shade",
        "The holes are a mask: a checkerboard for the opacity of a sphere.",
        "wdpm render docs/gallery/lattice.xml --spp 16",
    ),
    Picture(
        "knot",
        "A mesh alone",
        "A file that brings neither camera nor light is framed, put on a floor and lit "
        "([knot.stl](gallery/make_meshes.py) is made by a script).",
        "wdpm render out/gallery/knot.stl --size 320x214 --spp 16",
    ),
    Picture(
        "atrium",
        "An atrium on four slaves",
        "200,000 triangles, cut among four slaves, none of which has more than a third of them: the paper's way.",
        "wdpm render atrium:200k --size 320x200 --spp 16 --slaves 4 --copies none",
        brighter=0.8,
    ),
)


def main(names: list[str]) -> None:
    """Render pictures, and write them and the page."""
    wanted = [each for each in GALLERY if not names or each.name in names]
    OUT.mkdir(parents=True, exist_ok=True)
    PICTURES.mkdir(parents=True, exist_ok=True)
    for passes in OUT.glob("*.wdpm-passes"):  # of a run that was interrupted
        passes.unlink()
    subprocess.run([sys.executable, DOCS / "gallery" / "make_meshes.py", OUT], check=True)
    times: dict[str, Any] = json.loads(TIMES.read_text()) if TIMES.exists() else {}
    done: dict[str, Path] = {}
    for picture in wanted:
        if picture.command not in done:
            done[picture.command] = OUT / f"{picture.name}.exr"
            times[picture.command] = rendered(picture.command, done[picture.command])
        save(picture, done[picture.command])
        TIMES.write_text(json.dumps(times, indent=1, sort_keys=True) + "\n")
        PAGE.write_text(page(times))
        print(picture.name, times[picture.command], flush=True)


def rendered(command: str, output: Path) -> dict[str, float]:
    """Render; returns the CPU seconds of all cores."""
    words = [sys.executable, "-m", "wdpm", *shlex.split(command)[1:], "-q"]
    subprocess.run([*words, *QUICK, "-o", str(OUT / "quick.exr")], check=True, cwd=ROOT)
    before = _cpu()
    subprocess.run([*words, "-o", str(output)], check=True, cwd=ROOT)
    return {"cpu": round(_cpu() - before, 1)}


def _cpu() -> float:
    """Seconds that processes which have ended have computed."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def save(picture: Picture, image: Path) -> None:
    """Write a JPEG as good as its size allows."""
    layers, _ = read_exr(image)
    names = picture.layers or ("beauty",)
    tiles = [encode_srgb8(layers[name] * picture.brighter) for name in names]
    pixels = tiles[0] if len(tiles) == 1 else np.hstack([_halved(tile) for tile in tiles])
    for quality in range(92, 50, -4):
        data = imageio.imwrite("<bytes>", pixels, extension=".jpg", quality=quality)
        if len(data) <= LARGEST:
            break
    (PICTURES / f"{picture.name}.jpg").write_bytes(data)


def _halved(tile: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture of half the size: means of 2 x 2 pixels."""
    height, width = tile.shape[0] // 2, tile.shape[1] // 2
    blocks = tile[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3)
    return blocks.mean(axis=(1, 3)).round().astype(np.uint8)


def page(times: dict[str, Any]) -> str:
    """The page, in Markdown."""
    return (
        "\n\n".join([INTRODUCTION, *(_entry(each, times[each.command]) for each in GALLERY if each.command in times)])
        + "\n"
    )


INTRODUCTION = """\
# Gallery

Each picture with the command that renders it, from the root of a checkout. The scenes are small files in
[docs/gallery](gallery), in Mitsuba's format; `python docs/gallery/make_meshes.py out/gallery` makes the two meshes that
no file has. `make gallery` renders all of them anew and writes this page.

Times are CPU seconds of all cores together, from start to end of the command, on the machine of
[measured](measured.md), which was busy; kernels were compiled before. Pictures are as `-o FILE.png` writes them, unless
a factor says that they are shown brighter or darker."""


def _entry(picture: Picture, taken: dict[str, float]) -> str:
    suffix = "exr" if picture.layers else "png"
    shown = "" if picture.brighter == 1 else f" Shown {picture.brighter:g} times as bright."
    return (
        f"## {picture.title}\n\n![{picture.title}](pictures/gallery/{picture.name}.jpg)\n\n{picture.text}{shown}\n\n"
        f"```\n{picture.command} -o {picture.name}.{suffix}\n```\n\n{taken['cpu']:.0f} s."
    )


if __name__ == "__main__":
    main(sys.argv[1:])
