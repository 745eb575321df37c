"""From samples to pixels: in waves, by what they weigh, in one pixel each or in several."""
