"""Where a ray meets a triangle, and which cells it crosses."""

from wdpm.kernels.parsed_late import parse_late

parse_late()
