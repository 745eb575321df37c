"""Mathematics with the same bits everywhere: functions, random numbers, directions, exact sums."""

from wdpm.kernels.parsed_late import parse_late

parse_late()
