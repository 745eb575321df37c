"""Messages over ZeroMQ, between processes and machines. Nothing outside of this folder imports it."""
