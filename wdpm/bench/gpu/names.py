"""What kernels are called."""

from __future__ import annotations


def plain_name(key: str) -> str:
    """A kernel's name in its source: Warp puts the function around it in front of it."""
    return key.rsplit("__locals__", 1)[-1]
