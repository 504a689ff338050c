"""An oracle for timed motions in space: many poses, and distances by coal, a library that the package does not use.

It shares nothing with certificate and verifier: links are placed by scipy's rotations, bodies are coal's own shapes
where it has them, and whoever is far away is passed over until the link has moved as far as its gap was.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
from scipy.spatial.transform import Rotation

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, SphereBody
from tests.benchmarks.dense_sweep import HAIR, LEAST_SUBSTEPS, ROUNDING, STRAIGHT, Sweep

TRAVEL = 1e-3
"""No joint of the arm moves farther than this between two poses that are looked at [m]."""
TOUCH = 3e-6
"""Gap that may be missing: coal's iteration for shapes ends within 1 µm [m]."""
LOOK = 0.1
"""Gaps are not told apart beyond this [m]."""


@dataclass(frozen=True)
class CoalBody:
    """A body as coal knows it.

    Attributes:
        name: of the obstacle.
        shape: coal's geometry.
        place: coal's transform.
        rounding: to be taken off distances from the shape [m].
        centre: middle of a ball about the body, shape (3,) [m].
        reach: radius of that ball, with the rounding [m].
    """

    name: str
    shape: Any
    place: Any
    rounding: float
    centre: FloatArray
    reach: float


def sweep_in_space(problem: Problem, trajectory: JointTrajectory) -> Sweep:
    """Look at a timed motion, linear between its samples."""
    return sweep_rows(problem, trajectory.positions)


def sweep_rows(problem: Problem, samples: FloatArray) -> Sweep:
    """Look at a motion, linear between its samples (T, c), so densely that little can happen between poses."""
    arm = problem.arm
    rows = densely(arm, samples)
    points = chain_by_scipy(arm, rows)
    wall, name = least_wall_gap(problem, points)
    own = least_own_gap(arm, points) if arm.self_collision else LOOK
    bounds = np.concatenate((arm.bend_limits, [axis.high for axis in arm.base_axes]))
    lowest = np.concatenate((-arm.bend_limits, [axis.low for axis in arm.base_axes]))
    broken = {
        f"{1e3 * (problem.workspace.clearance - wall):.4f} mm too near to {name}": wall
        < problem.workspace.clearance - TOUCH,
        f"{-1e3 * own:.4f} mm into itself": own < -TOUCH,
        "joint limit": bool(np.any((rows > bounds + ROUNDING) | (rows < lowest - ROUNDING))),
        "misses the start": not np.allclose(rows[0], problem.start.configuration(arm), rtol=0.0, atol=1e-6),
        "misses the goal": not _reaches(problem, rows[-1], points[-1]),
        "bent in the guide tube": _bent_in_tube(arm, rows),
    }
    return Sweep(len(rows), wall, own, tuple(words for words, is_broken in broken.items() if is_broken))


def chain_by_scipy(arm: Arm, rows: FloatArray) -> FloatArray:
    """Base, joints and tip in configurations (T, c), shape (T, links + 1, 3) [m]."""
    left = np.cross(arm.up, arm.direction)
    turn = Rotation.from_matrix(np.tile(np.column_stack((arm.direction, left, arm.up)), (len(rows), 1, 1)))
    points = np.empty((len(rows), arm.links + 1, 3))
    points[:, 0] = arm.base + rows[:, 2 * arm.links :].sum(axis=1)[:, None] * arm.direction
    for link in range(arm.links):
        turn = turn * Rotation.from_euler("ZY", rows[:, 2 * link : 2 * link + 2])
        points[:, link + 1] = points[:, link] + turn.apply([arm.link_length, 0.0, 0.0])
    return points


def densely(arm: Arm, rows: FloatArray) -> FloatArray:
    """Configurations (T, c), each interval divided so that no joint moves far in a step [rad, m]."""
    points = chain_by_scipy(arm, rows)
    travel = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
    counts = np.maximum(LEAST_SUBSTEPS, np.ceil(travel / TRAVEL).astype(int))
    # Where samples are dense already, fewer between them will do.
    counts[travel < TRAVEL / LEAST_SUBSTEPS] = 1
    parts = [
        a + np.linspace(0.0, 1.0, count, endpoint=False)[:, None] * (b - a)
        for a, b, count in zip(rows[:-1], rows[1:], counts, strict=True)
    ]
    return np.vstack((*parts, rows[-1:]))


def least_wall_gap(problem: Problem, points: FloatArray) -> tuple[float, str]:
    """Least gap between links beyond the mount and any wall, at most ``LOOK`` [m], and the wall's name."""
    arm = problem.arm
    bodies = [coal_body(each.name, each.body) for each in problem.workspace.obstacles]
    least, name = LOOK, ""
    for link in range(arm.links):
        share = float(np.clip(arm.mount_length / arm.link_length - link, 0.0, 1.0))
        if share == 1.0:
            continue
        start = points[:, link] + share * (points[:, link + 1] - points[:, link])
        for gap, wall in _gaps_of_link(arm.radius, start, points[:, link + 1], bodies, problem.workspace.bounds):
            if gap < least:
                least, name = gap, wall
    return least, name


def least_own_gap(arm: Arm, points: FloatArray) -> float:
    """Least gap between links that are far apart along the arm, at most ``LOOK`` [m]."""
    apart = max(2.0 * arm.link_length, np.pi * arm.radius)
    between = int(np.ceil(apart / arm.link_length - 1e-9))
    first, second = np.triu_indices(arm.links, between + 1)
    middles = 0.5 * (points[:, :-1] + points[:, 1:])
    thin = coal.Capsule(arm.radius, arm.link_length)
    least = LOOK
    for begin in range(0, len(points), 256):
        part = middles[begin : begin + 256]
        # Middles that are far apart belong to links that are.
        gaps = np.linalg.norm(part[:, first] - part[:, second], axis=2) - arm.link_length - 2.0 * arm.radius
        for pose, pair in zip(*np.nonzero(gaps < min(least, 0.01)), strict=True):
            if gaps[pose, pair] >= least:
                continue
            places = [
                _along(points[begin + pose, link], points[begin + pose, link + 1])
                for link in (first[pair], second[pair])
            ]
            least = min(least, _distance(thin, places[0], thin, places[1]))
    return least


def coal_body(name: str, body: Body) -> CoalBody:
    """A body of the scene as one of coal's shapes, a mesh as triangles."""
    if isinstance(body, SphereBody):
        return CoalBody(
            name, coal.Sphere(body.radius), coal.Transform3s(np.eye(3), body.center), 0.0, body.center, body.radius
        )
    if isinstance(body, BoxBody):
        corners = body.corners
        # By their numbers the corners 1, 2 and 4 are the next ones along x, y and z.
        sides = corners[[1, 2, 4]] - corners[0]
        lengths = np.linalg.norm(sides, axis=1)
        centre = corners.mean(axis=0)
        place = coal.Transform3s((sides / lengths[:, None]).T.copy(), centre)
        return CoalBody(name, coal.Box(*lengths), place, 0.0, centre, 0.5 * float(np.linalg.norm(lengths)))
    if isinstance(body, CapsuleBody | CylinderBody):
        length = float(np.linalg.norm(body.end - body.start))
        kind = coal.Capsule if isinstance(body, CapsuleBody) else coal.Cylinder
        centre = 0.5 * (body.start + body.end)
        place = _along(body.start, body.end)
        return CoalBody(name, kind(body.radius, length), place, 0.0, centre, 0.5 * length + body.radius)
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(body.triangles), 3 * len(body.triangles))
    for triangle in body.triangles:
        mesh.addTriangle(*triangle)
    mesh.endModel()
    corners = body.triangles.reshape(-1, 3)
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    reach = float(np.linalg.norm(corners - centre, axis=1).max()) + body.rounding
    return CoalBody(name, mesh, coal.Transform3s.Identity(), body.rounding, centre, reach)


def _gaps_of_link(
    radius: float, starts: FloatArray, ends: FloatArray, bodies: list[CoalBody], bounds: FloatArray | None
) -> Iterable[tuple[float, str]]:
    """Gaps of one link at poses between which it cannot have come nearer to anything than by a step."""
    capsule = coal.Capsule(radius, float(np.linalg.norm(ends[0] - starts[0])))
    steps = np.maximum(np.linalg.norm(np.diff(starts, axis=0), axis=1), np.linalg.norm(np.diff(ends, axis=0), axis=1))
    travelled = np.concatenate(([0.0], np.cumsum(steps)))
    centres = np.array([body.centre for body in bodies]).reshape(-1, 3)
    reaches = np.array([body.reach for body in bodies])
    pose = 0
    while pose < len(starts):
        start, end = starts[pose], ends[pose]
        gap, wall = LOOK, ""
        if bounds is not None:
            both = np.stack((start, end))
            inside = float(min(np.min(both - bounds[0]), np.min(bounds[1] - both))) - radius
            gap, wall = min((gap, wall), (inside, "room"))
        least = _from_segment(centres, start, end) - reaches - radius
        place = _along(start, end)
        for k in np.argsort(least):
            if least[k] >= gap:
                break
            body = bodies[k]
            found = _distance(capsule, place, body.shape, body.place) - body.rounding
            gap, wall = min((gap, wall), (found, body.name))
        yield gap, wall
        # Nothing that is farther than the link moves can be met until then.
        pose = max(pose + 1, int(np.searchsorted(travelled, travelled[pose] + gap)))


def _distance(first: Any, place: Any, second: Any, other: Any) -> float:
    """Distance of two of coal's shapes, negative where they overlap [m]."""
    result = coal.DistanceResult()
    coal.distance(first, place, second, other, coal.DistanceRequest(), result)
    return float(result.min_distance)


def _along(start: FloatArray, end: FloatArray) -> Any:
    """Coal's transform of a shape along z onto a segment."""
    along = (end - start) / np.linalg.norm(end - start)
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    turn = np.column_stack((across, np.cross(along, across), along))
    return coal.Transform3s(turn, 0.5 * (start + end))


def _from_segment(places: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """Distances of places (k, 3) from a segment, shape (k,) [m]."""
    line = end - start
    share = np.clip((places - start) @ line / (line @ line), 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[:, None] * line - places, axis=1))


def _reaches(problem: Problem, row: FloatArray, chain: FloatArray) -> bool:
    """Whether a configuration, shape (c,), and its chain of joints are the goal, within its tolerances."""
    goal = problem.goal
    if isinstance(goal, JointPose):
        return bool(np.allclose(row, goal.configuration(problem.arm), rtol=0.0, atol=1e-6))
    off = float(np.linalg.norm(chain[-1] - goal.position))
    last = (chain[-1] - chain[-2]) / problem.arm.link_length
    # The chord between unit vectors is twice the sine of half of the angle.
    turn = 0.0 if goal.direction is None else 2.0 * float(np.arcsin(0.5 * np.linalg.norm(last - goal.direction)))
    return off <= problem.tolerances.position + ROUNDING and turn <= problem.tolerances.heading + ROUNDING


def _bent_in_tube(arm: Arm, rows: FloatArray) -> bool:
    """Whether a joint bends that has not passed the hole, in configurations (T, c)."""
    if arm.feed is None:
        return False
    places = rows[:, -1:] + arm.link_length * np.arange(arm.links)
    inside = np.repeat(places < arm.feed.hole - HAIR, 2, axis=1)
    return bool(np.any(np.abs(rows[:, : 2 * arm.links][inside]) > STRAIGHT))
