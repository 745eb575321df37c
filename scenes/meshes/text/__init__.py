"""Text that holds numbers, read by whole arrays."""
