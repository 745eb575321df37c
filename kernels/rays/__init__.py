"""Where a ray meets a triangle, and which cells it crosses."""

from wdpm.kernels.lazy_parsing import parse_lazily

parse_lazily()
