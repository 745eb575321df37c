"""Materials: from a hit to a scattering function, and how light scatters there and in media."""

from wdpm.kernels.parsed_late import parse_late

parse_late()
