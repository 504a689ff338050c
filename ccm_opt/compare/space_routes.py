"""Random routes through sites in space, and arms for them."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.inverse_kinematics import configuration_from_positions
from ccm_opt.robot.link_bodies import cylinder_inertia
from ccm_opt.robot.space_arm import SpaceArm
from ccm_opt.scene.bodies import Body

STEP = 0.004
"""Between the places of a route [m]."""


@dataclass(frozen=True, eq=False)
class Route:
    """Places on a way, even to a few millimetres; it runs on straight before and beyond.

    Attributes:
        places: shape (m, 3) [m].
    """

    places: FloatArray

    @classmethod
    def round_corners(cls, corners: FloatArray, radius: float) -> "Route | None":
        """Straight from corner to corner, with arcs of a radius in between; None where the corners are too near."""
        parts = [corners[0]]
        places: list[FloatArray] = []
        for before, corner, after in zip(corners[:-2], corners[1:-1], corners[2:], strict=True):
            inwards = (corner - before) / np.linalg.norm(corner - before)
            outwards = (after - corner) / np.linalg.norm(after - corner)
            turn = float(np.arccos(np.clip(inwards @ outwards, -1.0, 1.0)))
            if turn < 1e-3:
                continue
            cut = radius * np.tan(0.5 * turn)
            first = corner - cut * inwards
            if (first - parts[-1]) @ inwards < 0.0 or cut > float(np.linalg.norm(after - corner)):
                return None
            places.extend(_straight(parts[-1], first))
            places.extend(_arc(first, inwards, outwards, radius, turn))
            parts.append(corner + cut * outwards)
        places.extend(_straight(parts[-1], corners[-1]))
        places.append(corners[-1])
        return cls(np.stack(places))

    @cached_property
    def arcs(self) -> FloatArray:
        """Arc lengths of the places, shape (m,) [m]."""
        return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(self.places, axis=0), axis=1))))

    @property
    def length(self) -> float:
        """From its beginning to its end [m]."""
        return float(self.arcs[-1])

    def at(self, s: FloatArray) -> FloatArray:
        """Places at arc lengths, shape (..., 3) [m]."""
        places = np.stack([np.interp(s, self.arcs, column) for column in self.places.T], axis=-1)
        before = np.minimum(s, 0.0)[..., None] * self.direction_at_start
        beyond = np.maximum(s - self.length, 0.0)[..., None] * self.direction_at_end
        return np.asarray(places + before + beyond)

    @property
    def direction_at_start(self) -> FloatArray:
        """Unit vector, shape (3,)."""
        first = self.places[1] - self.places[0]
        return np.asarray(first / np.linalg.norm(first))

    @property
    def direction_at_end(self) -> FloatArray:
        """Unit vector, shape (3,)."""
        last = self.places[-1] - self.places[-2]
        return np.asarray(last / np.linalg.norm(last))

    def part(self, low: float, high: float) -> FloatArray:
        """Places between two arc lengths, shape (k, 3) [m]."""
        count = max(2, int(np.ceil((high - low) / STEP)) + 1)
        return self.at(np.linspace(low, high, count))


def laid_along(arm: SpaceArm, route: Route, end: float) -> FloatArray | None:
    """The configuration with all joints on a route and the tip near an arc length of it; None where it breaks limits.

    Args:
        arm: an arm, the line of whose base is that along which the route begins.
        route: from the end of the arm's guide tube, or from its fixed base.
        end: where the tip is [m].
    """
    base = 0.0
    if arm.base_axes:
        # The base stands where the rest of the arm reaches the end; chords are a little shorter than arcs.
        tube = float((route.places[0] - arm.base) @ arm.direction)
        base = end - arm.length
        for _ in range(8):
            reached = _chorded(route, base, arm)[1]
            base += end - reached
        if base > 0.0:
            return None
        low, high = arm.base_range
        if not low <= tube + base <= high:
            return None
    points, _ = _chorded(route, base, arm)
    if np.linalg.norm(np.cross(points[0] - arm.base, arm.direction)) > 1e-9:
        return None
    q = configuration_from_positions(arm, points)
    held = arm.held_bends(float(np.sum(q[2 * arm.links :])))
    if np.max(np.abs(q[: 2 * arm.links][held]), initial=0.0) > 1e-9:
        return None
    q[: 2 * arm.links][held] = 0.0
    return q if np.all(np.abs(q[: 2 * arm.links]) <= 0.97 * arm.bend_limits) else None


def _chorded(route: Route, start: float, arm: SpaceArm) -> tuple[FloatArray, float]:
    """Joints and tip a link apart along a route from an arc length on, and the arc length of the tip."""
    points = [route.at(np.array(start))]
    s = start
    for _ in range(arm.links):
        low = s
        high = s + 2.0 * arm.link_length
        for _ in range(60):
            middle = 0.5 * (low + high)
            if float(np.linalg.norm(route.at(np.array(middle)) - points[-1])) < arm.link_length:
                low = middle
            else:
                high = middle
        s = 0.5 * (low + high)
        step = route.at(np.array(s)) - points[-1]
        points.append(points[-1] + arm.link_length * step / np.linalg.norm(step))
    return np.stack(points), s


def _straight(start: FloatArray, end: FloatArray) -> list[FloatArray]:
    count = max(1, int(np.linalg.norm(end - start) / STEP))
    return [start + (end - start) * k / count for k in range(count)]


def _arc(first: FloatArray, inwards: FloatArray, outwards: FloatArray, radius: float, turn: float) -> list[FloatArray]:
    across = outwards - (outwards @ inwards) * inwards
    across /= np.linalg.norm(across)
    count = max(2, int(radius * turn / STEP))
    angles = turn * np.arange(count) / count
    return [first + radius * (np.sin(a) * inwards + (1.0 - np.cos(a)) * across) for a in angles]


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


USUAL_LINKS = 24
"""Of the shipped problems."""
MASS = 0.5
"""Of a whole arm [kg]."""
JOINT_LIMIT = float(np.deg2rad(45.0))
"""Of each bend where there are as many links as usual, or more [rad]."""


def arm_of_links(links: int, length: float, radius: float) -> SpaceArm:
    """An arm at the origin along x, whose base turns any way."""
    masses = np.full(links, MASS / links)
    axial, transverse = cylinder_inertia(masses, radius, length / links)
    return SpaceArm(
        links=links,
        link_length=length / links,
        radius=radius,
        base=np.zeros(3),
        direction=np.array([1.0, 0.0, 0.0]),
        up=np.array([0.0, 0.0, 1.0]),
        joint_limit=joint_limit(links),
        base_limit=2.0 * np.pi,
        self_collision=True,
        mount_length=radius,
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
    )


def joint_limit(links: int) -> float:
    """Bound on a bend [rad]: few links have to bend more for the same curve, up to a right angle."""
    return min(max(JOINT_LIMIT, JOINT_LIMIT * USUAL_LINKS / links), 0.5 * np.pi)


def with_links(arm: SpaceArm, links: int) -> SpaceArm:
    """An arm as long, thick and heavy, of another number of links, whose drives are all alike."""
    masses = np.full(links, float(np.sum(arm.masses)) / links)
    axial, transverse = cylinder_inertia(masses, arm.radius, arm.length / links)
    return replace(
        arm,
        links=links,
        link_length=arm.length / links,
        joint_limit=joint_limit(links),
        masses=masses,
        inertia_axial=axial,
        inertia_transverse=transverse,
        rotor_inertia=float(np.mean(arm.rotor_inertia)),
        friction=float(np.mean(arm.friction)),
    )
