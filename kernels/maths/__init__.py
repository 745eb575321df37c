"""Mathematics with the same bits everywhere: functions, random numbers, directions, exact sums."""

from wdpm.kernels.lazy_parsing import parse_lazily

parse_lazily()
