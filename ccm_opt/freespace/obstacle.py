"""What the arm must keep away from: a core, and the disc that is swept along it."""

from dataclasses import dataclass

import numpy as np
import shapely


@dataclass(frozen=True)
class Obstacle:
    """One obstacle, the set of points within ``rounding`` of ``core``; exact for every kind in a problem file.

    Attributes:
        name: the user's name for it, used in every message.
        core: a polygon (polygon, box), a point (circle) or a line string (wall) [m].
        rounding: radius of the disc that sweeps the core [m]; a circle's radius, half a wall's thickness, else 0.
    """

    name: str
    core: shapely.Geometry
    rounding: float = 0.0

    def outline(self, grow: float = 0.0, quad_segs: int = 8) -> shapely.Geometry:
        """The obstacle grown by ``grow`` [m], as a geometry that *contains* it (arcs are circumscribed)."""
        radius = self.rounding + grow
        if radius <= 0.0:
            return self.core
        circumscribed = radius / np.cos(np.pi / (4 * quad_segs))
        grown: shapely.Geometry = shapely.buffer(self.core, circumscribed, quad_segs=quad_segs)
        return grown
