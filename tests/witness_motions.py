"""Motions that scenes are drawn around, and what they sweep.

A fed arm whose joints follow its tip along a route, or a straight motion between two smooth poses of an arm on a fixed
base; bodies are then placed about all that it sweeps.
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
"""Bodies farther from the motion than this are of no interest [m]."""
MOST_BEND = np.deg2rad(55.0)
"""Of a joint of a motion; problems allow a little more [rad]."""


def followed(arm: Arm, route: Route, tips: FloatArray) -> FloatArray:
    """Return configurations (T, c) with all joints on a route and the tip at arc lengths of it, shape (T,) [m].

    Raises:
        UselessDraw: a joint would bend too far, or before it has left the guide tube, which ends at the origin.
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
    """Return a route straight for its lead [m] and then with random curvature, as a rule gentler than a radius [m]."""
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
    """Return bends (2 links,) of a random smooth pose that turns by so much in all [rad], upwards by a share of it."""
    knots = rng.normal(size=(2, int(rng.integers(3, 7))))
    places = np.linspace(0.0, 1.0, arm.links)
    bends = np.column_stack([np.interp(places, np.linspace(0.0, 1.0, len(row)), row) for row in knots])
    bends *= bend / np.sum(np.linalg.norm(bends, axis=1)) * np.array([1.0, flat])
    bends[0] = rng.normal(size=2) * (0.6, 0.6 * flat)
    return bends.ravel()


class Swept:
    """What an arm sweeps on a motion that is linear between configurations (T, c)."""

    def __init__(self, arm: Arm, rows: FloatArray) -> None:
        self.arm = arm
        middles = 0.5 * (rows[:-1] + rows[1:])
        self.chains = arm.joint_positions_at(np.concatenate((rows, middles)))
        """Joints and tips, shape (n, links + 1, 3) [m]."""

    @cached_property
    def points(self) -> FloatArray:
        """Places on the axes of links some millimetres apart, shape (m, 3) [m]."""
        count = int(np.ceil(self.arm.link_length / STEP))
        shares = np.arange(count)[:, None] / count
        steps = np.diff(self.chains, axis=1)[:, :, None]
        return np.asarray((self.chains[:, :-1, None] + shares * steps).reshape(-1, 3))

    @cached_property
    def axes(self) -> FloatArray:
        """Axes of links, shape (n links, 2, 3) [m]."""
        return np.stack((self.chains[:, :-1], self.chains[:, 1:]), axis=2).reshape(-1, 2, 3)

    def gap(self, body: Body) -> float:
        """Return how far the arm's surface is from a body's, at most ``LOOK`` [m]."""
        tree = SurfaceTree.of(TriangleSoup.joined([("", body.triangles, body.rounding)]))
        return float(tree.distances(self.axes, LOOK).min()) - self.arm.radius

    def opening(self, middle: FloatArray, normal: FloatArray, room: float) -> tuple[FloatArray, float]:
        """Return middle and radius [m] of a round hole of a thin plate, about where the arm passes it at a place."""
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
        """Return the radius of a pipe about a part of a route that leaves the arm in it a room [m]."""
        return float(np.max(self.widths(route, low, high, room)))

    def widths(self, route: Route, low: float, high: float, room: float) -> FloatArray:
        """Return the radius of a pipe at the places of a part of a route, shape (k,) [m]."""
        places = route.part(low, high)
        apart, nearest = map(np.asarray, cKDTree(places).query(self.points))
        # What passes elsewhere, and what is before or beyond the ends, does not count.
        inside = (apart < 0.08) & (nearest > 0) & (nearest < len(places) - 1)
        widths = np.zeros(len(places))
        np.maximum.at(widths, nearest[inside], apart[inside])
        return np.asarray(1.005 * (widths + self.arm.radius + room))

    def beside(self, rng: np.random.Generator, body: Body, room: float) -> Body | None:
        """Return a body about the origin, moved beside the motion, just so near [m] or somewhere; None if it fails."""
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
        """Return up to so many bodies beside the motion, each with a room of its own."""
        tries = (self.beside(rng, draw(), room()) for _ in range(4 * count))
        return [body for body in tries if body is not None][:count]
