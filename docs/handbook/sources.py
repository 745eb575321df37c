"""Links from the pages to code and other files of the repository lead to pages that show those files."""

from __future__ import annotations

import html
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from docutils import nodes
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import TextLexer, get_lexer_for_filename
from pygments.util import ClassNotFound
from sphinx import addnodes
from sphinx.transforms import SphinxTransform

DOCS = Path(__file__).resolve().parents[1]
ROOT = DOCS.parent
PAGES = {"README.md": "index", "CHANGELOG.md": "changes"}
"""Files outside docs/ that are pages of the site."""


def setup(app: Any) -> None:
    """Make it known to Sphinx."""
    app.add_transform(LinksToSources)
    app.connect("env-purge-doc", _forget)
    app.connect("html-collect-pages", _pages)


class LinksToSources(SphinxTransform):
    """Turns links to files and folders outside the pages into links to pages that show them."""

    default_priority = 100

    def apply(self, **_: Any) -> None:
        """Change one page."""
        for link in [*self.document.findall(_leaves_the_pages)]:
            target = _target(link, self.env.docname)
            if not target.exists() or not target.is_relative_to(ROOT):
                continue  # Sphinx says what is wrong
            name = target.relative_to(ROOT).as_posix()
            page = PAGES.get(name, f"source/{name}")
            if name not in PAGES:
                _linked(self.env).setdefault(self.env.docname, set()).add(name)
            uri = self.app.builder.get_relative_uri(self.env.docname, page)
            text = link.children[0].children if link.children else [nodes.Text(name)]
            link.replace_self(nodes.reference("", "", *text, internal=True, refuri=uri))


def _leaves_the_pages(node: nodes.Node) -> bool:
    """Whether Sphinx takes a link for a file to download, for a page that lies elsewhere, or does not know it."""
    if isinstance(node, addnodes.download_reference):
        return True
    if not isinstance(node, addnodes.pending_xref) or node.get("reftype") != "myst":
        return False
    if node.get("refdomain") == "doc":
        return str(node["reftarget"]).startswith("/")
    return not node.get("refdomain") and not node["reftarget"].startswith("#")


def _target(link: nodes.Element, page: str) -> Path:
    """The file or folder that a link on a page leads to."""
    name = unquote(link["reftarget"])
    if link.get("refdomain") == "doc":
        name += ".md"
    return Path(os.path.normpath((DOCS / page).parent / name))


def _linked(env: Any) -> dict[str, set[str]]:
    """Files and folders that each page links to."""
    if not hasattr(env, "wdpm_sources"):
        env.wdpm_sources = {}
    found: dict[str, set[str]] = env.wdpm_sources
    return found


def _forget(_app: Any, env: Any, page: str) -> None:
    _linked(env).pop(page, None)


def _pages(app: Any) -> Iterator[tuple[str, dict[str, Any], str]]:
    """The pages that show what is linked to, with the files of linked folders."""
    wanted = set().union(*_linked(app.env).values())
    folders = {name for name in wanted if (ROOT / name).is_dir()}
    for name in sorted(folders):
        wanted |= {(Path(name) / each.name).as_posix() for each in _files(ROOT / name)}
        yield f"source/{name}", _page(name, _list(name)), "page.html"
    for name in sorted(wanted - folders):
        yield f"source/{name}", _page(name, _shown(ROOT / name)), "page.html"


def _page(name: str, body: str) -> dict[str, Any]:
    return {"title": name, "parents": [], "body": f"<h1>{html.escape(name)}</h1>{body}"}


def _files(folder: Path) -> list[Path]:
    return sorted(each for each in folder.iterdir() if each.is_file() and not each.name.startswith("."))


def _list(name: str) -> str:
    """Links to the files of a folder, whose pages lie in a folder beside its own."""
    last = Path(name).name
    items = "".join(f'<li><a href="{last}/{each.name}.html">{each.name}</a></li>' for each in _files(ROOT / name))
    return f"<ul>{items}</ul>"


def _shown(path: Path) -> str:
    """A file, with its syntax in colours."""
    try:
        lexer = get_lexer_for_filename(path.name)
    except ClassNotFound:
        lexer = TextLexer()
    return str(highlight(path.read_text(errors="replace"), lexer, HtmlFormatter()))
