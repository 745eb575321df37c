"""How messages travel: what masters and slaves need from a network, and its implementations."""
