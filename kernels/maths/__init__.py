"""Mathematics with the same bits everywhere: functions, random numbers, directions, exact sums."""
