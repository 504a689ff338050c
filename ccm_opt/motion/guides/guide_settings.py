"""Settings of the guides, which say where the arm should go next."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GuideSettings:
    """Numbers of the guides and of the candidates made of them."""
