"""Settings of the trees of poses, the fall-back of the search."""

from dataclasses import dataclass


@dataclass(frozen=True)
class TreeSettings:
    """Numbers of the trees of poses."""
