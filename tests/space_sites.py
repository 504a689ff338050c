"""Random scenes in space with bays, walls and plates, and random problems in all families of scenes.

Each family is a function that returns random bodies and a path along which an arm can lie with some clearance. So a
goal pose exists, and for a fed arm that follows its tip, nearly a motion too. Scenes of odd seeds are rotated at
random. Arms are 0.9 m long with a radius of usually 12 mm. Openings are wider for arms with few links, which cut
corners.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from ccm_opt.cli.compare.space_clutter import arm_of_links, axes_of, links_apart
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import Feed
from ccm_opt.robot.coordinates import Limits
from ccm_opt.robot.inverse_kinematics import configuration_from_positions
from ccm_opt.scene.bodies import BoxBody, CapsuleBody, CylinderBody, RigidPlacement
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, Workspace
from tests.arms import held_bends

from .space_ducts import Site, bent_pipe, other_branch, slots, tank, tee
from .space_shapes import ORIGIN, Bodies, Route, UselessDraw, X, box, holed_plate, ring, straight_pipe, unit

LENGTH = 0.9
"""Length of the arms [m]."""
TRAVEL = 0.85
"""Travel of the feed axes [m]."""
SHOWN = 0.02
"""Length of a fed arm outside its guide tube at the start [m]."""
LEAST_GAP = 0.004
"""Minimum clearance of start and goal poses [m]."""
BEND_RADIUS = 0.1
"""Radius of curvature for which openings are widened if links are long [m]."""
MOST_DRAWS = 400
"""Maximum number of invalid scenes before an error is raised."""


def frames(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene with a fuselage, in which the arm turns outwards between two frames to the skin."""
    inner = float(rng.uniform(0.09, 0.13))
    outer = inner + float(rng.uniform(0.09, 0.12))
    apart = 0.09 + 2.0 * wider + float(rng.uniform(0.0, 0.05))
    first = float(rng.uniform(0.05, 0.1))
    count = int(rng.integers(4, 6))
    last = first + (count - 1) * apart
    bodies: Bodies = {"skin": straight_pipe(first * X - 0.02 * X, (last + 0.02) * X, outer)}
    bodies |= {f"frame {k + 1}": ring((first + k * apart) * X, X, inner, outer) for k in range(count)}
    for k in range(8):
        side = (outer - 0.01) * _across(2.0 * np.pi * (k + 0.5) / 8.0)
        bodies[f"stringer {k + 1}"] = CapsuleBody(first * X + side, last * X + side, 0.006)
    x = first + (int(rng.integers(1, count - 1)) + 0.5) * apart
    outwards = _across(float(rng.uniform(0.0, 2.0 * np.pi)))
    depth = outer - float(rng.uniform(0.03, 0.05))
    corners = np.stack((ORIGIN, x * X, x * X + depth * outwards))
    route = Route.round_corners(corners, float(rng.uniform(0.06, 0.09)))
    return Site(bodies, ((route, route.length),), directed=bool(rng.uniform() < 0.7))


def _across(turn: float) -> FloatArray:
    """Return a unit vector perpendicular to x, at an angle [rad] from y."""
    return np.array([0.0, np.cos(turn), np.sin(turn)])


def blades(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene with two rows of blades; the arm passes between blades of both rows and then turns aside."""
    hub = 0.09 - wider
    casing = 0.2 + wider
    radius = 0.5 * (hub + casing)
    count = int(rng.integers(9, 14))
    stagger = float(rng.uniform(0.2, 0.5))
    first = float(rng.uniform(0.08, 0.12))
    chord = 0.05
    second = first + chord + float(rng.uniform(0.1, 0.14))
    # The axis of the engine lies below the guide tube.
    axis = np.array([0.0, 0.0, -radius])
    shell = axis + 0.03 * X, axis + (second + 0.3) * X
    bodies: Bodies = {"hub": straight_pipe(*shell, hub), "casing": straight_pipe(*shell, casing)}
    shift = float(rng.uniform(-0.5, 0.5))
    for row, x, offset, tilt in (("stator", first, 0.5, stagger), ("rotor", second, 0.5 + shift, -stagger)):
        half = np.array([0.5 * chord / np.cos(tilt), 0.001, 0.5 * (casing - hub) - 0.004])
        for k in range(count):
            turn = 2.0 * np.pi * (k + offset) / count
            radial = np.array([0.0, np.sin(turn), np.cos(turn)])
            along = np.cos(tilt) * X + np.sin(tilt) * np.array([0.0, np.cos(turn), -np.sin(turn)])
            frame = np.column_stack((along, np.cross(radial, along), radial))
            middle = axis + radius * radial + (x + 0.5 * chord) * X
            bodies[f"{row} blade {k + 1}"] = BoxBody(-half, half, RigidPlacement(middle, frame))
    turned = 2.0 * np.pi * shift / count
    inside = float(np.tan(stagger)) * chord / radius
    side = 1.0 if rng.uniform() < 0.5 else -1.0
    ways = (
        (first, -0.5 * inside),
        (first + chord, 0.5 * inside),
        (second, turned + 0.5 * inside),
        (second + chord, turned - 0.5 * inside),
        (second + chord + 0.09, turned + side * float(rng.uniform(0.15, 0.5))),
    )
    between = [axis + x * X + radius * np.array([0.0, np.sin(angle), np.cos(angle)]) for x, angle in ways]
    route = Route.round_corners(np.stack((ORIGIN, 0.03 * X, *between)), 0.07)
    return Site(bodies, ((route, route.length),), radius=0.007)


def bays(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene with a closed box; the arm enters through a hole in the skin, then passes holes of ribs."""
    half = float(rng.uniform(0.09, 0.12))
    hole = 0.012 + wider + float(rng.uniform(0.022, 0.035))
    skin = float(rng.uniform(0.05, 0.1))
    # The box lies along z; the arm comes in across.
    apart = 0.16 + float(rng.uniform(0.0, 0.03))
    low, high = -apart + 0.02, 2.4 * apart
    thick = 0.003
    upper = skin + 2.0 * half
    bodies: Bodies = {
        "lower skin": holed_plate(skin * X, X, hole, 0.45),
        "upper skin": box([upper, -0.45, -0.45], [upper + thick, 0.45, 0.45]),
        "front spar": box([skin, -half - thick, low], [upper, -half, high]),
        "rear spar": box([skin, half, low], [upper, half + thick, high]),
        "root rib": box([skin, -half, low - thick], [upper, half, low]),
    }
    corners = []
    for k in range(int(rng.integers(1, 3))):
        aside = rng.uniform(-0.2, 0.2, 2) * half
        corners.append(np.array([skin + half + aside[0], aside[1], 0.7 * apart + k * apart]))
        bodies[f"rib {k + 1}"] = holed_plate(corners[-1], np.array([0.0, 0.0, 1.0]), hole, half - 0.25 * half)
    goal = corners[-1] + [*rng.uniform(-0.4, 0.4, 2) * half, float(rng.uniform(0.08, 0.13))]
    route = Route.round_corners(np.stack((ORIGIN, corners[0][0] * X, *corners, goal)), 0.075)
    return Site(bodies, ((route, route.length),))


def u_turn(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene with a wall beside the guide tube; the arm turns around its edge and back on the other side."""
    near = 0.03 + wider + float(rng.uniform(0.0, 0.03))
    far = near + float(rng.uniform(0.02, 0.06))
    end = float(rng.uniform(0.2, 0.3))
    across = 2.0 * float(rng.uniform(0.08, 0.12))
    back = float(rng.uniform(0.08, 0.2))
    rise = float(rng.uniform(-0.06, 0.06))
    bodies: Bodies = {
        "wall": box([-0.4, near, -0.5], [end, far, 0.5]),
        "outer wall": box([-0.4, far + across, -0.5], [end + 0.4, far + across + 0.02, 0.5]),
        "ceiling": box([0.05, -0.3, 0.12], [end + 0.4, far + across, 0.14]),
        "ground": box([0.05, -0.3, -0.14], [end + 0.4, far + across, -0.12]),
    }
    y = far + 0.5 * across
    corner = end + 0.045 + wider + 0.5 * y
    points = [[0, 0, 0], [corner, 0.0, 0.0], [corner, y, rise], [end - back, y, rise]]
    route = Route.round_corners(np.array(points), 0.5 * y - 0.002 if abs(rise) < 1e-9 else 0.42 * y)
    if route.length > 0.82:
        raise UselessDraw
    return Site(bodies, ((route, route.length),))


def holes(rng: np.random.Generator, wider: float, *, passed: bool) -> Site:
    """Return a scene with two or three plates with round holes at different positions, which may be via points."""
    count = int(rng.integers(2, 4))
    places = [float(rng.uniform(0.05, 0.1)) * X]
    for _ in range(count - 1):
        x = places[-1][0] + float(rng.uniform(0.15, 0.22))
        places.append(np.array([x, *(places[-1][1:] + rng.uniform(-0.09, 0.09, 2))]))
    hole = 0.012 + wider + float(rng.uniform(0.015, 0.035))
    bodies: Bodies = {f"plate {k}": holed_plate(place, X, hole, 0.35) for k, place in enumerate(places, start=1)}
    beside = [place + step * X for place in places for step in (-0.02, 0.02)]
    goal = places[-1] + np.array([rng.uniform(0.1, 0.2), *rng.uniform(-0.12, 0.12, 2)])
    route = Route.round_corners(np.stack((ORIGIN, *beside[1:], goal)), 0.07)
    return Site(bodies, ((route, route.length),), via=tuple(places) if passed else ())


def post(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene for an arm with a fixed base and a goal behind a post, pointing back."""
    radius = float(rng.uniform(0.03, 0.07))
    place = np.array([float(rng.uniform(0.3, 0.45)), radius + 0.025 + wider + float(rng.uniform(0.0, 0.02))])
    bodies: Bodies = {
        "post": CylinderBody(np.append(place, -0.6), np.append(place, 0.6), radius),
        "wall": box([-0.3, place[1] + radius + 0.25, -0.6], [1.1, place[1] + radius + 0.27, 0.6]),
    }
    if rng.uniform() < 0.5:
        other = place + np.array([rng.uniform(-0.3, -0.2), rng.uniform(0.1, 0.15)])
        bodies["second post"] = CylinderBody(np.append(other, -0.6), np.append(other, 0.6), 0.02)
    round_it = radius + 0.03 + wider + float(rng.uniform(0.01, 0.03))
    far, y = place + round_it
    back = place[0] - float(rng.uniform(0.0, 0.1))
    rise = float(rng.uniform(-0.15, 0.15))
    corners = np.array([[0, 0, 0], [far, -0.01, 0.3 * rise], [far, y, 0.7 * rise], [back, y, rise]])
    route = Route.round_corners(corners, 0.45 * y)
    whole = _of_whole_length(route, 0.5 * float(np.linalg.norm(route.places[-1])) + 0.2, rng)
    return Site(bodies, ((whole, LENGTH),), fed=False, directed=bool(rng.uniform() < 0.7))


def _of_whole_length(route: Route, width: float, rng: np.random.Generator) -> Route:
    """Return a path extended to the length of the arms by a bow over its first part of a given width [m].

    Raises:
        UselessDraw: the path is too long, or too short.
    """
    if not 0.005 < LENGTH - route.length < 0.3:
        raise UselessDraw
    side = rng.normal(size=3) * np.array([0.0, 1.0, 1.0])
    side[1] = -abs(side[1])
    side = unit(side)
    wave = np.sin(np.pi * np.clip(route.arcs / width, 0.0, 1.0)) ** 2
    # A bow of a sine over the first part lengthens it by about (π h / w)² w / 4.
    low, high = 0.0, 0.5
    bowed = route
    for _ in range(40):
        height = 0.5 * (low + high)
        bowed = Route(route.places + (height * wave)[:, None] * side)
        low, high = (height, high) if bowed.length < LENGTH else (low, height)
    return Route(route.places + (low * wave)[:, None] * side)


def reach_in(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene for an arm with a fixed base that has to reach through a hole of a plate."""
    x = float(rng.uniform(0.35, 0.45))
    place = np.array([x, *rng.uniform(-0.1, 0.1, 2)])
    hole = 0.012 + wider + float(rng.uniform(0.025, 0.05))
    goal = place + np.array([rng.uniform(0.15, 0.3), *rng.uniform(-0.1, 0.1, 2)])
    across = 0.4 * _across(rng.uniform(0.0, 2.0 * np.pi))
    route = Route.round_corners(np.stack((ORIGIN, place - 0.04 * X, place + 0.04 * X, goal)), 0.08)
    aside = Route.round_corners(np.stack((ORIGIN, 0.12 * X, 0.12 * X + across, -0.3 * X + across)), 0.1)
    ends = (aside, LENGTH), (_of_whole_length(route, x - 0.05, rng), LENGTH)
    bodies: Bodies = {"plate": holed_plate(place, X, hole, 0.5)}
    return Site(bodies, ends, fed=False, directed=bool(rng.uniform() < 0.7))


def other_hole(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene with an arm in one of two holes of a plate that has to retract and pass the other hole."""
    x = float(rng.uniform(0.2, 0.3))
    apart = 0.5 * float(rng.uniform(0.1, 0.16))
    half = 0.015 + wider + float(rng.uniform(0.015, 0.025))
    if apart < half + 0.01:
        raise UselessDraw
    # A plate with two square holes, of five bars.
    bodies: Bodies = {
        "plate above": box([x, -0.4, half], [x + 0.004, 0.4, 0.4]),
        "plate below": box([x, -0.4, -0.4], [x + 0.004, 0.4, -half]),
        "plate, right": box([x, -0.4, -half], [x + 0.004, -apart - half, half]),
        "plate between the holes": box([x, -apart + half, -half], [x + 0.004, apart - half, half]),
        "plate, left": box([x, apart + half, -half], [x + 0.004, 0.4, half]),
    }
    routes = []
    for side in (-1.0, 1.0):
        place = np.array([x, side * apart, 0.0])
        goal = place + np.array([rng.uniform(0.12, 0.3), *rng.uniform(-0.1, 0.1, 2)])
        corners = np.stack((ORIGIN, 0.03 * X, place - 0.03 * X, place + 0.03 * X, goal))
        routes.append(Route.round_corners(corners, 0.08))
    return Site(bodies, tuple((route, route.length) for route in routes))


SITES: Mapping[str, Callable[[np.random.Generator, float], Site]] = {
    "pipe-two-bends": partial(bent_pipe, bends=2),
    "pipe-three-bends": partial(bent_pipe, bends=3),
    "tee": partial(tee, whole_pose=False),
    "tee-pose": partial(tee, whole_pose=True),
    "tank": tank,
    "hairpin": partial(slots, turns=1),
    "double-back": partial(slots, turns=2),
    "u-turn": u_turn,
    "holes": partial(holes, passed=False),
    "holes-via": partial(holes, passed=True),
    "post": post,
    "reach-in": reach_in,
    "other-hole": other_hole,
    "other-branch": other_branch,
    "frames": frames,
    "blades": blades,
    "bays": bays,
}
"""Functions that return a random scene, by name of the family."""


def site_problem(family: str, seed: int, links: int, name: str) -> Problem:
    """Return the random problem of a family for a seed.

    Args:
        family: name of the family.
        seed: seed of the random numbers.
        links: number of links of the arm.
        name: name of the problem.

    Raises:
        ProblemError: no valid scene was found for this arm.
    """
    rng = np.random.default_rng([seed, sum(map(ord, family))])
    # Half the distance between a link and an arc of the bend radius through its ends.
    wider = (LENGTH / links) ** 2 / (8.0 * BEND_RADIUS)
    for _ in range(MOST_DRAWS):
        try:
            problem = _problem(SITES[family](rng, wider), links, name)
        except UselessDraw:
            continue
        if seed % 2 == 0:
            return problem
        return _turned(problem, RigidPlacement.of_quaternion(rng.uniform(-0.3, 0.3, 3), rng.normal(size=4)))
    raise ProblemError(f"no scene of the family {family} leaves an arm of {links} links its room")


def _problem(site: Site, links: int, name: str) -> Problem:
    """Return the problem of a scene.

    Raises:
        UselessDraw: the arm cannot lie along the paths of the scene.
    """
    arm = arm_of_links(links, LENGTH, site.radius)
    rates = np.ones(3 * links)
    limits = Limits(rates, 4.0 * rates)
    if site.fed:
        # The guide tube ends at the origin.
        outside = LENGTH - SHOWN
        arm = replace(arm, base=np.array([-outside, 0.0, 0.0]), feed=Feed(0.0, TRAVEL, outside))
        limits = replace(limits, feed_velocity=0.1, feed_acceleration=0.5)
    workspace = Workspace(bounds=None, obstacles=tuple(Obstacle(*item) for item in site.bodies.items()))
    tree = SurfaceTree.from_triangles(workspace.triangle_soup)
    ends = [laid_along(arm, route, end) for route, end in site.routes]
    if len(ends) == 1:
        ends = [np.zeros_like(ends[0]), *ends]
    for q in ends:
        _refuse_contact(tree, arm, q)
    start, goal = (JointPose.from_configuration(q, arm.coordinates) for q in ends)
    direction = arm.link_rotations(ends[1])[-1, :, 0] if site.directed else None
    tip = TipGoal(arm.joint_positions_at(ends[1])[-1], direction, site.via)
    return Problem(name, workspace, arm, limits, start, goal if site.whole_pose else tip)


def laid_along(arm: Arm, route: Route, end: float) -> FloatArray:
    """Return the configuration with all joints on a path and the tip near a given arc length, shape (c,) [rad, m].

    Args:
        arm: the arm, whose base is directed along the start of the path.
        route: path from the end of the guide tube, or from the fixed base.
        end: arc length of the tip [m].

    Raises:
        UselessDraw: the configuration exceeds limits.
    """
    base = 0.0
    if arm.base_axes:
        # Find the base position for which the tip is at the end; chords are slightly shorter than arcs.
        base = end - arm.length
        for _ in range(8):
            base += end - _chorded(route, base, arm)[1]
        low, high = arm.base_range
        if base > 0.0 or not low <= float((route.places[0] - arm.base) @ arm.direction) + base <= high:
            raise UselessDraw
    points, _ = _chorded(route, base, arm)
    q = configuration_from_positions(arm, points)
    bends = q[: 2 * arm.links]
    held = held_bends(arm, float(np.sum(q[2 * arm.links :])))
    beside = np.linalg.norm(np.cross(points[0] - arm.base, arm.direction)) > 1e-9
    if beside or np.max(np.abs(bends[held]), initial=0.0) > 1e-9 or np.any(np.abs(bends) > 0.97 * arm.bend_limits):
        raise UselessDraw
    bends[held] = 0.0
    return q


def _chorded(route: Route, start: float, arm: Arm) -> tuple[FloatArray, float]:
    """Return joints and tip on a path, spaced by a link, shape (links + 1, 3) [m], and the arc length of the tip [m].

    Args:
        route: the path.
        start: arc length of the first joint [m].
        arm: the arm.
    """
    points = [route.at(np.array(start))]
    s = start
    for _ in range(arm.links):
        low, high = s, s + 2.0 * arm.link_length
        for _ in range(60):
            s = 0.5 * (low + high)
            near = float(np.linalg.norm(route.at(np.array(s)) - points[-1])) < arm.link_length
            low, high = (s, high) if near else (low, s)
        s = 0.5 * (low + high)
        step = route.at(np.array(s)) - points[-1]
        points.append(points[-1] + arm.link_length * step / np.linalg.norm(step))
    return np.stack(points), s


def _refuse_contact(tree: SurfaceTree, arm: Arm, q: FloatArray) -> None:
    """Check that a configuration has the minimum clearance from bodies and between links.

    Raises:
        UselessDraw: the clearance is smaller.
    """
    points = arm.joint_positions_at(q)
    axes = axes_of(points)[int(np.ceil(arm.mount_length / arm.link_length)) :]
    kept = arm.radius + LEAST_GAP
    if tree.distances(axes, 2.0 * kept).min() <= kept or not links_apart(arm, points, 2.0 * LEAST_GAP):
        raise UselessDraw


def _turned(problem: Problem, by: RigidPlacement) -> Problem:
    """Return a problem with arm, obstacles and goal moved by a rigid transformation."""
    arm = problem.arm
    turned = by.rotation
    obstacles = tuple(Obstacle(each.name, each.body.placed(by)) for each in problem.workspace.obstacles)
    goal = problem.goal
    if goal.whole(arm) is None:
        direction = None if goal.direction is None else turned @ goal.direction
        via = tuple(by.points(place[None])[0] for place in goal.via)
        goal = TipGoal(by.points(goal.tip(arm)[None])[0], direction, via)
    base = by.points(arm.base[None])[0]
    moved = replace(arm, base=base, direction=turned @ arm.direction, up=turned @ arm.up)
    return replace(problem, workspace=replace(problem.workspace, obstacles=obstacles), arm=moved, goal=goal)
