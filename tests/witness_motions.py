"""Feasible motions of arms around which random scenes are built, and the volumes that the motions sweep.

A motion is either the feed of an arm whose joints follow the tip along a path, or a straight motion in joint space
between two smooth poses of an arm with a fixed base. Bodies are then placed around the swept volume.
"""

from collections.abc import Callable
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.inverse_kinematics import configuration_from_positions
from ccm_opt.scene.bodies import Body
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.surfaces import TriangleSoup

from .arms import held_bends
from .space_shapes import STEP, Route, UselessDraw, unit

LOOK = 0.3
"""Distance from the motion beyond which bodies are ignored [m]."""
MOST_BEND = np.deg2rad(55.0)
"""Maximum bend angle of a joint in a motion [rad]; the joint limits of problems are slightly larger."""


def followed(arm: Arm, route: Route, tips: FloatArray) -> FloatArray:
    """Return configurations with all joints on a path and the tip at given arc lengths, shape (T, c) [rad, m].

    Args:
        arm: the arm.
        route: the path.
        tips: arc lengths of the tip, shape (T,) [m].

    Raises:
        UselessDraw: a joint bends too much, or bends inside the guide tube, which ends at the origin.
    """
    s = np.asarray(tips, dtype=np.float64)
    points = [route.at(s)]
    for _ in range(arm.links):
        low, high = s - 1.6 * arm.link_length, s - arm.link_length
        for _ in range(45):
            s = 0.5 * (low + high)
            near = np.linalg.norm(route.at(s) - points[-1], axis=1) < arm.link_length
            low, high = np.where(near, low, s), np.where(near, s, high)
        step = route.at(s) - points[-1]
        points.append(points[-1] + arm.link_length * step / np.linalg.norm(step, axis=1)[:, None])
    chains = np.stack(points[::-1], axis=1)
    if np.max(np.abs(chains[:, 0, 1:])) > 1e-9 or np.max(chains[:, 0, 0]) > 0.0:
        raise UselessDraw
    q = configuration_from_positions(arm, chains)
    bends = q[:, : 2 * arm.links]
    held = held_bends(arm, q[:, -1])
    if np.max(np.abs(bends[held]), initial=0.0) > 1e-8 or np.max(np.abs(bends)) > MOST_BEND:
        raise UselessDraw
    bends[held] = 0.0
    return q


def meander(rng: np.random.Generator, lead: float, length: float, radius: float) -> Route:
    """Return a random path that is straight at first and then has random curvature.

    Args:
        rng: random generator.
        lead: length of the straight part [m].
        length: length of the path [m].
        radius: radius of curvature that the path usually exceeds [m].
    """
    arcs = np.arange(0.0, length, STEP)
    knots = rng.normal(size=(int(rng.integers(4, 7)), 2))
    shares = np.linspace(0.0, 1.0, len(knots))
    curvature = np.column_stack([np.interp((arcs - lead) / (length - lead), shares, column) for column in knots.T])
    curvature *= float(rng.uniform(0.5, 0.9)) / radius / np.max(np.linalg.norm(curvature, axis=1))
    curvature[arcs < lead] = 0.0
    way, across = np.eye(3)[:2]
    places = [np.zeros(3)]
    for one, other in curvature[:-1]:
        way = unit(way + STEP * (one * across + other * np.cross(way, across)))
        across = unit(across - (across @ way) * way)
        places.append(places[-1] + STEP * way)
    return Route(np.stack(places))


def smooth_bends(rng: np.random.Generator, arm: Arm, bend: float, flat: float) -> FloatArray:
    """Return the bend angles of a random smooth pose, shape (2 links,) [rad].

    Args:
        rng: random generator.
        arm: the arm.
        bend: approximate sum of the magnitudes of the joint angles, before ``flat`` is applied [rad].
        flat: factor on the bend angles about the second axis.
    """
    knots = rng.normal(size=(2, int(rng.integers(3, 7))))
    places = np.linspace(0.0, 1.0, arm.links)
    bends = np.column_stack([np.interp(places, np.linspace(0.0, 1.0, len(row)), row) for row in knots])
    bends *= bend / np.sum(np.linalg.norm(bends, axis=1)) * np.array([1.0, flat])
    bends[0] = rng.normal(size=2) * (0.6, 0.6 * flat)
    return bends.ravel()


class Swept:
    """Volume that an arm sweeps on a piecewise-linear motion through configurations of shape (T, c) [rad, m]."""

    def __init__(self, arm: Arm, rows: FloatArray) -> None:
        self.arm = arm
        middles = 0.5 * (rows[:-1] + rows[1:])
        self.chains = arm.joint_positions_at(np.concatenate((rows, middles)))
        """Joints and tips, shape (n, links + 1, 3) [m]."""

    @cached_property
    def points(self) -> FloatArray:
        """Points on the axes of the links a few millimetres apart, shape (m, 3) [m]."""
        count = int(np.ceil(self.arm.link_length / STEP))
        shares = np.arange(count)[:, None] / count
        steps = np.diff(self.chains, axis=1)[:, :, None]
        return np.asarray((self.chains[:, :-1, None] + shares * steps).reshape(-1, 3))

    @cached_property
    def axes(self) -> FloatArray:
        """Axes of the links as segments, shape (n links, 2, 3) [m]."""
        return np.stack((self.chains[:, :-1], self.chains[:, 1:]), axis=2).reshape(-1, 2, 3)

    def gap(self, body: Body) -> float:
        """Return the distance between the surfaces of the swept arm and a body, at most about ``LOOK`` [m]."""
        tree = SurfaceTree.from_triangles(TriangleSoup.joined([("", body.triangles, body.rounding)]))
        return float(tree.distances(self.axes, LOOK).min()) - self.arm.radius

    def opening(self, middle: FloatArray, normal: FloatArray, room: float) -> tuple[FloatArray, float]:
        """Return centre, shape (3,) [m], and radius [m] of a round hole in a thin plate through which the arm passes.

        Args:
            middle: point of the plate, shape (3,) [m].
            normal: unit normal of the plate, shape (3,).
            room: clearance of the arm in the hole [m].

        Raises:
            UselessDraw: the arm does not pass near the point.
        """
        off = self.points - middle
        along = off @ normal
        across = off - along[:, None] * normal
        near = (np.abs(along) < 0.7 * self.arm.radius) & (np.linalg.norm(across, axis=1) < 0.12)
        if not np.any(near):
            raise UselessDraw
        aside = across[near]
        shift = 0.5 * (aside.min(axis=0) + aside.max(axis=0))
        shift -= (shift @ normal) * normal
        widest = float(np.max(np.linalg.norm(aside - shift, axis=1)))
        return middle + shift, widest + self.arm.radius + room + 0.0005

    def width(self, route: Route, low: float, high: float, room: float) -> float:
        """Return the radius of a pipe around a part of a path, with a given clearance from the arm [m]."""
        return float(np.max(self.widths(route, low, high, room)))

    def widths(self, route: Route, low: float, high: float, room: float) -> FloatArray:
        """Return radii of a pipe at k points of a path, with a given clearance from the arm, shape (k,) [m]."""
        places = route.part(low, high)
        apart, nearest = map(np.asarray, cKDTree(places).query(self.points))
        # Parts of the arm outside the pipe, before its start or after its end, are ignored.
        inside = (apart < 0.08) & (nearest > 0) & (nearest < len(places) - 1)
        widths = np.zeros(len(places))
        np.maximum.at(widths, nearest[inside], apart[inside])
        return np.asarray(1.005 * (widths + self.arm.radius + room))

    def beside(self, rng: np.random.Generator, body: Body, room: float) -> Body | None:
        """Return a body moved to a random position beside the motion, often at minimum clearance, or None.

        Args:
            rng: random generator.
            body: body at the origin.
            room: minimum clearance between body and arm [m].
        """
        place = self.points[rng.integers(len(self.points))]
        way = unit(rng.normal(size=3))
        far = float(rng.uniform(0.02, 0.25))
        if self.gap(body.moved(place + far * way)) < room:
            return None
        low, high = 0.0, far
        for _ in range(6 if rng.uniform() < 0.6 else 0):
            middle = 0.5 * (low + high)
            free = self.gap(body.moved(place + middle * way)) >= room
            low, high = (low, middle) if free else (middle, high)
        return body.moved(place + high * way)

    def strew(
        self, rng: np.random.Generator, draw: Callable[[], Body], count: int, room: Callable[[], float]
    ) -> list[Body]:
        """Return at most ``count`` random bodies at random positions beside the motion.

        Args:
            rng: random generator.
            draw: function that returns a random body at the origin.
            count: maximum number of bodies.
            room: function that returns the minimum clearance of a body [m].
        """
        tries = (self.beside(rng, draw(), room()) for _ in range(4 * count))
        return [body for body in tries if body is not None][:count]
