"""The handbook's own modules, those that need no Sphinx, are imported by their names."""

from __future__ import annotations

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
sys.path[:0] = [str(DOCS), str(DOCS / "handbook"), str(DOCS / "gallery")]
