"""Sphinx's configuration of the handbook: `make handbook` builds docs/ into out/handbook.

The pages are plain Markdown that reads well without Sphinx too. What turns them into a site is in the modules beside
this file; nothing that the site needs is fetched from elsewhere when it is read.
"""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import filled_in
import mathml
import navigation
import sources
from pygments.lexers import TextLexer

project = "wdpm"
author = "the authors of wdpm"
version = release = metadata.version("wdpm")
html_title = f"wdpm {version}"
html_theme = "furo"
html_show_copyright = False
html_show_sourcelink = False
html_copy_source = False
html_static_path = ["style"]
html_css_files = ["handbook.css"]

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
smartquotes = False  # it would make one dash of the two of an option
source_suffix = {".md": "markdown"}
exclude_patterns = ["handbook", "gallery"]
nitpicky = False  # docstrings name types of NumPy and of the standard library, which are not part of the site

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
"""Headings have the anchors that code hosts give them, so that links hold there and here."""

default_role = "literal"  # docstrings have code in single backticks
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_class_signature = "separated"
html_math_renderer = mathml.NAME


def setup(app: Any) -> None:
    """Sphinx calls this once."""
    app.add_lexer(
        "mermaid", TextLexer
    )  # code hosts draw these diagrams; drawing them here would take a script of megabytes
    for each in (mathml, navigation, filled_in, sources):
        each.setup(app)
