"""`wdpm render` with slaves that something else places."""
