"""Every page has its place in the navigation, and the gallery is what its script writes."""

from __future__ import annotations

import json
from pathlib import Path

import make_gallery
import navigation
import pytest

from wdpm.scenes.load import load

DOCS = Path(__file__).resolve().parents[2] / "docs"
SCENES = sorted((DOCS / "gallery").glob("*.xml"))
ALL_PICTURES = 500_000
"""Bytes of the gallery's pictures."""


def test_every_page_is_in_the_navigation_once() -> None:
    listed = [page for pages in navigation.parts((DOCS / "index.md").read_text()).values() for page in pages]
    there = {path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.rglob("*.md")}
    assert sorted(listed) == sorted(there - {navigation.INDEX}), "list each page once in docs/index.md"


def test_the_navigation_is_made_of_headings_and_links() -> None:
    text = "# A\n\n## Part\n\n* [One](one.md): text, and [another](no.md)\n* [Two](how-to/two.md)\n\n## Words\n\nnone\n"
    assert navigation.parts(text) == {"Part": ["one", "how-to/two"]}


def test_the_gallery_is_what_its_script_writes() -> None:
    assert make_gallery.PAGE.read_text() == make_gallery.page(json.loads(make_gallery.TIMES.read_text()))


def test_every_picture_of_the_gallery_is_there_and_small() -> None:
    times = json.loads(make_gallery.TIMES.read_text())
    rendered = [each.name for each in make_gallery.GALLERY if each.command in times]
    sizes = {name: (make_gallery.PICTURES / f"{name}.jpg").stat().st_size for name in rendered}
    assert max(sizes.values()) <= make_gallery.LARGEST
    assert sum(sizes.values()) <= ALL_PICTURES
    assert sizes.keys() == {path.stem for path in make_gallery.PICTURES.iterdir()}


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.name)
def test_scenes_of_the_gallery_are_read_as_they_are_meant(path: Path, tmp_path: Path) -> None:
    text = path.read_text()
    if 'type="ply"' in text:  # the script makes the mesh
        import make_meshes

        make_meshes.main(tmp_path)
        path = tmp_path / path.name
        path.write_text(text.replace("../../out/gallery", str(tmp_path)))
    scene = load(path)
    assert [warning for warning in scene.warnings if "sunsky" not in warning] == []  # what its model becomes is said
    assert len(scene.meshes) >= 4
