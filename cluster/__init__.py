"""Who computes it: partition, cells, master, slave and the wire between them."""
