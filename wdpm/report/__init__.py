"""What a render says of itself, and the tables and plots that tell it."""
