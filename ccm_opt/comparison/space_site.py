"""What a family of work places draws."""

from dataclasses import dataclass, field

from ccm_opt.comparison.space_routes import Route
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.scene.bodies import Body


@dataclass(frozen=True, eq=False)
class Site:
    """Bodies and the ways among them; a fed arm's guide tube ends at the origin, a fixed arm's base is there.

    Both point along x.

    Attributes:
        bodies: with their names.
        routes: on which the arm lies at the goal, up to an arc length; where there are two, at the start on the first.
        fed: whether the arm has a feed axis.
        directed: whether the goal asks for a direction.
        whole_pose: whether the goal is a pose of all joints.
        via: places that the tip has to pass, each of shape (3,) [m].
        radius: of the arm [m].
    """

    bodies: list[tuple[str, Body]]
    routes: tuple[tuple[Route, float], ...]
    fed: bool = True
    directed: bool = True
    whole_pose: bool = False
    via: tuple[FloatArray, ...] = field(default=())
    radius: float = 0.012
