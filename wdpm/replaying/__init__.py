"""One sample of one pixel, told vertex by vertex (`--replay`)."""
