"""Images: layers, files, comparison, pictures of differences."""
