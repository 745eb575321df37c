"""The same scenes in wdpm and in Cycles: cameras, units of lights, textures, modifiers, materials."""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
Passes = Mapping[str, NDArray[np.float32]]


def names_of_scenes() -> list[str]:
    """Without Blender: the functions that are decorated as scenes."""
    tree = ast.parse((HERE / "scenes_in_blender.py").read_text())
    functions = [node for node in tree.body if isinstance(node, ast.FunctionDef)]
    return [each.name for each in functions if any(ast.unparse(by) == "scene" for by in each.decorator_list)]


MEAN = 0.015
"""How far the mean may be off, as a share, where nothing else is said: noise of both, and of few photons."""

FAR_MEAN = {
    "principled": 0.02,
    "principled_metal": 0.02,  # Cycles brings light back that microfacets scatter several times
    "principled_rough": 0.03,
    "glass_and_gloss": 0.03,
    "light_in_view": 0.02,  # 64 lights stand for each
    "light_soft_sun_and_spot": 0.03,
    "interior": 0.03,
    "curtains": 0.035,  # 30,000 photons on a floor of 20 m blur the light of the cloth: with a million it is 0.003
    "diffuse_under_gloss": 0.04,  # plastic: its base is darker, where Blender's Fresnel only mixes
}

SPREAD = 0.07
"""Of single pixels (root of the mean square), as a share of the mean."""

FAR_SPREAD = {"principled_half_there": 0.13, "glass_and_gloss": 0.15, "interior": 0.15, "light_soft_sun_and_spot": 0.12}

EDGE = 0.09
"""Share of pixels whose depth is another one: those that an edge goes through."""

NO_EDGES = {"depth_of_field", "cut_out"}
"""Where depth is another one: ours is a mean over the lens, and that of a mask where Cycles has what is behind it."""


@pytest.fixture(scope="session")
def pictures(
    in_blender: Callable[..., str], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[str], tuple[Passes, Passes, str]]:
    """Renders all scenes once; hands out the passes of wdpm and of Cycles by name, and what wdpm said."""
    folder = tmp_path_factory.mktemp("pictures")
    in_blender("render_in_blender.py", folder, *names_of_scenes())

    def of(name: str) -> tuple[Passes, Passes, str]:
        both = np.load(folder / f"{name}.npz", allow_pickle=False)
        ours, cycles = (
            {key.split("/")[1]: both[key] for key in both.files if key.startswith(whose)}
            for whose in ("wdpm", "cycles")
        )
        return ours, cycles, (folder / f"{name}.txt").read_text()

    return of


@pytest.mark.timeout(1500)
@pytest.mark.parametrize("name", names_of_scenes())
def test_the_picture_is_that_of_cycles(name: str, pictures: Callable[[str], tuple[Passes, Passes, str]]) -> None:
    ours, cycles, _ = pictures(name)
    a, b = (each["Combined"][..., :3].astype(np.float64) for each in (ours, cycles))
    assert a.shape == b.shape
    assert b.mean() > 0.01
    means = a.mean(axis=(0, 1)) / b.mean(axis=(0, 1)) - 1.0
    assert np.abs(means).max() < FAR_MEAN.get(name, MEAN), means
    spread = np.sqrt(((a - b) ** 2).mean()) / b.mean()
    assert spread < FAR_SPREAD.get(name, SPREAD)


@pytest.mark.timeout(1500)
@pytest.mark.parametrize("name", [name for name in names_of_scenes() if name not in NO_EDGES])
def test_things_are_where_cycles_has_them(name: str, pictures: Callable[[str], tuple[Passes, Passes, str]]) -> None:
    ours, cycles, _ = pictures(name)
    a, b = ours["Depth.Z"], cycles["Depth.Z"]
    assert (np.abs(a - b) > 0.01 * b).mean() < EDGE
    for axis in "XYZ":
        assert np.abs(ours[f"Normal.{axis}"] - cycles[f"Normal.{axis}"]).mean() < 0.01


@pytest.mark.timeout(1500)
def test_kinds_of_light_make_the_picture(pictures: Callable[[str], tuple[Passes, Passes, str]]) -> None:
    ours, _, _ = pictures("interior")
    parts = ours["Direct"] + ours["Indirect"] + ours["Caustic"] + ours["Volume"]
    np.testing.assert_allclose(parts, ours["Combined"][..., :3], rtol=1e-3, atol=1e-4)
    assert ours["Indirect"].mean() > ours["Direct"].mean()


@pytest.mark.timeout(1500)
def test_lights_in_view_are_named(pictures: Callable[[str], tuple[Passes, Passes, str]]) -> None:
    said = pictures("light_in_view")[2]
    for name in ("Area", "Point"):
        assert f'WARNING: light "{name}": it is in view, where Blender hides it' in said
    assert "WARNING" not in pictures("default")[2]
