"""How finely bodies are made of triangles."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SceneSettings:
    """How bodies become triangles.

    Attributes:
        cylinder_sides: of the prism about a cylinder. Taste: the prism stands out of the cylinder by 0.21 % of its
            radius at most, and has 188 triangles.
    """

    cylinder_sides: int = 48

    @property
    def cylinder_error(self) -> float:
        """How far the prism stands out of its cylinder, as a share of the cylinder's radius."""
        return float(1.0 / np.cos(np.pi / self.cylinder_sides) - 1.0)


SCENE = SceneSettings()
"""Used where no other settings are given."""
