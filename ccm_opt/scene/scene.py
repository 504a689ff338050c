"""The scene in space: bodies, sides of the room and what is asked of them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.scene.bodies import BOX_FACES, Body, BoxBody, MeshBody, RigidPlacement, SphereBody, box_corners
from ccm_opt.scene.surfaces import SurfaceSoup, box_about


def moved_body(body: Body, by: FloatArray) -> Body:
    """A body that stands elsewhere.

    Args:
        body: any.
        by: how far it is moved, shape (3,) [m].
    """
    if isinstance(body, SphereBody):
        return replace(body, center=body.center + by)
    if isinstance(body, BoxBody):
        return replace(body, placement=_moved(body.placement, by))
    if isinstance(body, MeshBody):
        # Its vertices are in the room already.
        return replace(body, vertices=body.vertices + by, placement=_moved(body.placement, by))
    return replace(body, start=body.start + by, end=body.end + by)


def _moved(placement: RigidPlacement, by: FloatArray) -> RigidPlacement:
    return replace(placement, position=placement.position + by)


ROOM_NAME = "room"
"""What the sides of the room are called."""


@dataclass(frozen=True)
class SpaceObstacle:
    """One obstacle.

    Attributes:
        name: the user's name for it, used in every message.
        body: its shape, where it stands.
    """

    name: str
    body: Body


@dataclass(frozen=True)
class SpaceWorkspace:
    """What the arm moves in.

    Attributes:
        bounds: lower and upper corner of the room, whose sides are walls, shape (2, 3) [m]; None where there is no
            room.
        obstacles: the obstacles, in the order of the file.
        clearance: least gap kept between the arm's surface and every obstacle [m].
    """

    bounds: FloatArray | None
    obstacles: tuple[SpaceObstacle, ...] = ()
    clearance: float = 0.0

    @cached_property
    def soup(self) -> SurfaceSoup:
        """The surfaces of all obstacles in their order, then the sides of the room."""
        named = [(each.name, each.body.triangles, each.body.rounding) for each in self.obstacles]
        if self.bounds is not None:
            named.append((ROOM_NAME, box_corners(self.bounds[0], self.bounds[1])[BOX_FACES], 0.0))
        return SurfaceSoup.joined(named)

    @cached_property
    def extent(self) -> FloatArray:
        """Lower and upper corner of everything, shape (2, 3) [m]; zeros where there is nothing."""
        if len(self.soup) == 0:
            return np.zeros((2, 3))
        bodies = [each.body for each in self.obstacles if len(each.body.triangles)]
        grown = [box_about(body.triangles) + body.rounding * np.array([[-1.0], [1.0]]) for body in bodies]
        if self.bounds is not None:
            grown.append(self.bounds)
        return box_about(np.stack(grown))

    def without(self, name: str) -> "SpaceWorkspace":
        """The same without the obstacles of a name."""
        return replace(self, obstacles=tuple(each for each in self.obstacles if each.name != name))

    def middle_of(self, name: str) -> FloatArray:
        """Middle of the box about an obstacle of a name, shape (3,) [m]."""
        body = next(each.body for each in self.obstacles if each.name == name)
        return np.asarray(box_about(body.triangles).mean(axis=0))

    def with_moved(self, name: str, by: FloatArray) -> "SpaceWorkspace":
        """The same with the obstacles of a name moved by so much, shape (3,) [m]."""

        def moved(obstacle: SpaceObstacle) -> SpaceObstacle:
            return replace(obstacle, body=moved_body(obstacle.body, by)) if obstacle.name == name else obstacle

        return replace(self, obstacles=tuple(map(moved, self.obstacles)))
