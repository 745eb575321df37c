"""What a slave computes: light in its cells, and the homes of its tasks."""
