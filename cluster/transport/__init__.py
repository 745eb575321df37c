"""How messages travel: through memory, or through ZeroMQ between processes and machines."""
