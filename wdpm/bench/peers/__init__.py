"""wdpm and Mitsuba 3: times to the same errors."""
