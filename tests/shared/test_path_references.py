"""Path tracing against Mitsuba 3's, pixel by pixel: two unbiased estimates differ by their noise and by nothing else.

Independent seeds of both give each pixel's mean and its variance. The difference over its deviation, z, is then about
standard normal in every pixel, and so it is in blocks of pixels, which see a smaller bias: that of one material, say.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import wdpm
from wdpm.cluster.render_settings import Integrator, RenderSettings
from wdpm.images.image import load as load_image
from wdpm.scenes.load import load

pytestmark = pytest.mark.shared

Array = NDArray[np.float64]

SEEDS = 16
SPP = {"ours": 32, "theirs": 64}
BLOCK = 4
"""Side of a block of pixels."""


@dataclass(frozen=True)
class Comparison:
    """Two estimates of one image.

    Attributes:
        z: of the mean of the channels in each pixel, shape [height, width].
        blocks: the same of blocks of pixels.
        total: of all pixels together.
        difference: of the whole images' means, as a share.
    """

    z: Array
    blocks: Array
    total: float
    difference: float

    def assert_unbiased(self) -> None:
        """As wide as noise is, and nowhere more.

        Of 2 x 16 seeds z is Student's, with 30 degrees of freedom and a deviation of 1.035; one in 25,000 blocks lies
        beyond 4.8. Single pixels have a noise of few large samples, which are among the 16 seldom: their z is of less
        spread, and its mean is off where one of the renderers has more of such noise.
        """
        assert 0.8 < self.z.std() < 1.15, self.z.std()
        assert abs(self.z.mean()) < 0.3, self.z.mean()
        assert (np.abs(self.z) > 4).mean() < 0.004, (np.abs(self.z) > 4).mean()
        assert np.abs(self.blocks).max() < 4.8, np.round(self.blocks, 1)
        assert 0.8 < self.blocks.std() < 1.3, self.blocks.std()
        assert abs(self.total) < 4, (self.total, self.difference)


def z_of(ours: Array, theirs: Array) -> Array:
    """Welch's statistic of seeds along the first axis; 0 where neither has any noise, if they agree there."""
    gap = ours.mean(axis=0) - theirs.mean(axis=0)
    noise = np.sqrt(ours.var(axis=0, ddof=1) / len(ours) + theirs.var(axis=0, ddof=1) / len(theirs))
    still = noise <= 1e-6 * np.abs(theirs.mean(axis=0))
    np.testing.assert_allclose(gap[still], 0.0, atol=1e-4)
    return np.asarray(np.where(still, 0.0, gap / np.where(still, 1.0, noise)))


def compared(ours: Array, theirs: Array) -> Comparison:
    """Compare images of several seeds, shapes [seeds, height, width]."""
    seeds, height, width = ours.shape
    shape = (seeds, height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    blocks = z_of(ours.reshape(shape).mean(axis=(2, 4)), theirs.reshape(shape).mean(axis=(2, 4)))
    whole = z_of(ours.mean(axis=(1, 2))[:, None], theirs.mean(axis=(1, 2))[:, None])
    return Comparison(z_of(ours, theirs), blocks, float(whole[0]), float(ours.mean() / theirs.mean() - 1.0))


def our_images(file: Path, size: tuple[int, int]) -> Array:
    """Means of the channels, shape [seeds, height, width]."""
    scene = load(file, size=size)
    chosen = {"integrator": Integrator.PATH, "spp": SPP["ours"], "max_depth": scene.max_depth}
    images = [wdpm.render(scene, RenderSettings(seed=seed, **chosen)).pixels for seed in range(SEEDS)]
    return np.mean(np.array(images, np.float64), axis=3)


def their_images(file: Path, size: tuple[int, int], integrator: str = "path") -> Array:
    """The same by Mitsuba."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    scene = mi.load_file(str(file), resx=size[0], resy=size[1])
    depth = load(file).max_depth
    chosen = mi.load_dict({"type": integrator, "max_depth": -1 if depth is None else depth})
    images = [np.array(mi.render(scene, integrator=chosen, spp=SPP["theirs"], seed=seed)) for seed in range(SEEDS)]
    return np.mean(np.array(images, np.float64), axis=3)


def edited(source: Path, folder: Path, *changes: tuple[str, str]) -> Path:
    """A copy of a scene file next to which its meshes can be found, with some of its text replaced."""
    text = (source / "scene.xml").read_text()
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    copy = folder / source.name
    copy.mkdir()
    for other in source.iterdir():
        if other.name != "scene.xml":
            (copy / other.name).symlink_to(other)
    (copy / "scene.xml").write_text(text)
    return copy / "scene.xml"


def test_two_boxes(scenes_dir: Path) -> None:
    file = scenes_dir / "cbox" / "scene.xml"
    compared(our_images(file, (40, 40)), their_images(file, (40, 40))).assert_unbiased()


@pytest.mark.slow
def test_the_comparison_sees_a_wrong_material(scenes_dir: Path, tmp_path: Path) -> None:
    """One wall of the box that is 10 % too bright: 1 % of the whole image."""
    red = '<rgb name="reflectance" value="0.63 0.065 0.05" />'
    brighter = edited(scenes_dir / "cbox", tmp_path, (red, '<rgb name="reflectance" value="0.693 0.0715 0.055" />'))
    comparison = compared(our_images(brighter, (40, 40)), their_images(scenes_dir / "cbox" / "scene.xml", (40, 40)))
    assert comparison.blocks.max() > 6
    with pytest.raises(AssertionError):
        comparison.assert_unbiased()


@pytest.mark.slow
def test_plates_of_many_roughnesses(scenes_dir: Path) -> None:
    file = scenes_dir / "veach-mis" / "scene.xml"
    compared(our_images(file, (64, 36)), their_images(file, (64, 36))).assert_unbiased()


@pytest.mark.slow
def test_glass_and_mirror(scenes_dir: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a guide to caustics: with one their noise is Mitsuba's alone, of rare samples, which is not normal.

    (test_guided_caustics.py compares guided paths with Lambert's formula.)
    """
    monkeypatch.setattr("wdpm.cluster.plan.caustics.guide.WORTH", 0.0)
    file = scenes_dir / "glass-cbox" / "scene.xml"
    compared(our_images(file, (40, 40)), their_images(file, (40, 40))).assert_unbiased()


@pytest.mark.slow
def test_eight_materials(scenes_dir: Path, tmp_path: Path) -> None:
    """All materials that there are, in light of an area, a spot and a sky.

    As the scene is, Mitsuba 3.9 errs in two places, and so does the reference. Its `blendbsdf` adds the probability of
    a mirror's direction and the density of a diffuse one as if they were of a kind, so that mirrors in blends lose a
    quarter of their light: a rough metal takes the mirror's place here. And `path` lets no shadow ray through the holes
    of a `mask`, so that the spot does not shine through; `volpath` does.
    """
    mirror = '<bsdf type="conductor"><string name="material" value="Ag"/></bsdf>'
    rough = mirror.replace('"conductor"', '"roughconductor"').replace(
        "/></bsdf>", '/><float name="alpha" value="0.1"/></bsdf>'
    )
    file = edited(scenes_dir / "materials", tmp_path, (mirror, rough))
    compared(our_images(file, (48, 48)), their_images(file, (48, 48), "volpath")).assert_unbiased()


@pytest.mark.slow
def test_fog_around_the_lamp(scenes_dir: Path, tmp_path: Path) -> None:
    """The fog is raised by 32 mm so that the lamp hangs in it: test_effect_references.py says why."""
    file = edited(
        scenes_dir / "fog-cbox",
        tmp_path,
        ('<scale x="0.999" y="0.98" z="0.999"/>', '<scale x="0.999" y="0.99675" z="0.999"/>'),
        ('<translate x="0" y="0.985" z="0"/>', '<translate x="0" y="1.00175" z="0"/>'),
    )
    compared(our_images(file, (40, 40)), their_images(file, (40, 40), "volpath")).assert_unbiased()


@pytest.mark.parametrize("name", ["cbox", pytest.param("sibenik", marks=pytest.mark.slow)])
def test_mean_of_the_reference(name: str, scenes_dir: Path) -> None:
    """The shared references, of thousands of samples a pixel."""
    reference = load_image(scenes_dir / name / "reference.exr").pixels
    ours = our_images(scenes_dir / name / "scene.xml", (64, 64)).mean(axis=(1, 2))
    assert (
        abs(ours.mean() / reference.mean(dtype=np.float64) - 1.0)
        < 4 * ours.std(ddof=1) / np.sqrt(SEEDS) / ours.mean() + 5e-4
    )
