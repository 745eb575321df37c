"""Materials: from a hit to a scattering function, and how light scatters there and in media."""

from wdpm.kernels.lazy_parsing import parse_lazily

parse_lazily()
