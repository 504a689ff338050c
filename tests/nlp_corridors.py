"""Corridors of convex regions and random curves, for tests of the configuration NLP."""

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.configuration_task import ConfigurationTask
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.corridor import ConvexRegion, Corridor, Route

ANY_HEADING = (-2.0 * np.pi, 2.0 * np.pi)


def region(vertices: FloatArray) -> ConvexRegion:
    """Return a convex region from counter-clockwise vertices, shape (m, 2) [m]."""
    edges = np.roll(vertices, -1, axis=0) - vertices
    normals = np.column_stack((edges[:, 1], -edges[:, 0])) / np.hypot(*edges.T)[:, None]
    return ConvexRegion(vertices, normals, (normals * vertices).sum(axis=1))


def box(x0: float, y0: float, x1: float, y1: float) -> ConvexRegion:
    """Return an axis-parallel rectangular region between two opposite corners [m]."""
    return region(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))


def corridor(regions: tuple[ConvexRegion, ...], taut: list[tuple[float, float]]) -> Corridor:
    """Return a corridor of convex regions with a given shortest path; its portals are all zero and must not be used."""
    points = np.array(taut)
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    return Corridor(Route((), points, length), regions, np.zeros((len(regions) - 1, 2, 2)))


def s_bend() -> Corridor:
    """Return a corridor of a room, a passage upwards 0.2 m wide and a passage to the right, 1.1 m long in all."""
    regions = (box(-0.2, -0.3, 0.5, 0.3), box(0.3, -0.3, 0.5, 0.6), box(0.3, 0.4, 1.2, 0.6))
    return corridor(regions, [(0.0, 0.0), (0.3, 0.3), (0.5, 0.4), (0.9, 0.5)])


def open_task(pose: Configuration, limit: float = 15.0) -> ConfigurationTask:
    """Return the task of reaching the tip pose of a known curve in an open room, with the base pose of this curve."""
    tip, heading = pose.tip
    way = corridor((box(-1.2, -1.2, 1.2, 1.2),), [(0.0, 0.0), (float(tip[0]), float(tip[1]))])
    fixed = (pose.base_heading, pose.base_heading)
    return ConfigurationTask(np.zeros(2), fixed, pose.length, limit, tip, heading, way)


def random_pose(generator: np.random.Generator) -> Configuration:
    """Return a random curve of one segment of length 1 m, with the tip at least 5 cm from the base."""
    while True:
        curvature = np.clip(generator.normal(0.0, 3.0, 5), -8.0, 8.0)
        pose = Configuration.chain(np.zeros(2), generator.uniform(-np.pi, np.pi), [1.0], [curvature])
        if np.hypot(*pose.tip[0]) > 0.05:
            return pose
