"""Random sites in space: bays and walls.

A family draws bodies and a route among them which an arm could lie along with some room: so the pose at the goal
exists, and for a fed arm whose links follow its tip the motion nearly does too. All of it is turned at random for odd
seeds. The arm is 0.9 m long with a radius of 12 mm; with few links openings are wider, since chords cut corners.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from ccm_opt.cli.compare import space_ducts
from ccm_opt.cli.compare.space_clutter import Route, Site, arm_of_links, laid_along
from ccm_opt.cli.compare.space_ducts import X, box, holed_plate, ring, straight_pipe
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, RigidPlacement, SphereBody
from ccm_opt.scene.distances.enclosures import segment_distances
from ccm_opt.scene.distances.surface_tree import SurfaceTree
from ccm_opt.scene.workspace import Obstacle, Workspace


def frames(rng: np.random.Generator, wider: float) -> Site | None:
    """Along a fuselage, then outwards between two of its frames to its skin."""
    inner = float(rng.uniform(0.09, 0.13))
    outer = inner + float(rng.uniform(0.09, 0.12))
    apart = 0.09 + 2.0 * wider + float(rng.uniform(0.0, 0.05))
    first = float(rng.uniform(0.05, 0.1))
    count = int(rng.integers(4, 6))
    middle = np.stack((first * X - 0.02 * X, (first + (count - 1) * apart + 0.02) * X))
    bodies: list[tuple[str, Body]] = [("skin", straight_pipe(middle[0], middle[1], outer))]
    bodies += [(f"frame {k + 1}", ring((first + k * apart) * X, X, inner, outer)) for k in range(count)]
    for k in range(8):
        turn = 2.0 * np.pi * (k + 0.5) / 8.0
        side = (outer - 0.01) * np.array([0.0, np.cos(turn), np.sin(turn)])
        bodies.append(
            (f"stringer {k + 1}", CapsuleBody(first * X + side, (first + (count - 1) * apart) * X + side, 0.006))
        )
    bay = int(rng.integers(1, count - 1))
    x = first + (bay + 0.5) * apart
    turn = float(rng.uniform(0.0, 2.0 * np.pi))
    outwards = np.array([0.0, np.cos(turn), np.sin(turn)])
    depth = outer - float(rng.uniform(0.03, 0.05))
    corners = np.stack((np.zeros(3), x * X, x * X + depth * outwards))
    route = Route.round_corners(corners, float(rng.uniform(0.06, 0.09)))
    return None if route is None else Site(bodies, ((route, route.length),), directed=bool(rng.uniform() < 0.7))


def blades(rng: np.random.Generator, wider: float) -> Site | None:
    """Between the blades of one row, aside, then between those of the next, and round behind them."""
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
    bodies: list[tuple[str, Body]] = [
        ("hub", straight_pipe(*shell, hub)),
        ("casing", straight_pipe(*shell, casing)),
    ]
    shift = float(rng.uniform(-0.5, 0.5))
    for row, x, offset, sense in (("stator", first, 0.5, 1.0), ("rotor", second, 0.5 + shift, -1.0)):
        for k in range(count):
            turn = 2.0 * np.pi * (k + offset) / count
            tilt = sense * stagger
            radial = np.array([0.0, np.sin(turn), np.cos(turn)])
            around = np.array([0.0, np.cos(turn), -np.sin(turn)])
            along = np.cos(tilt) * X + np.sin(tilt) * around
            frame = np.column_stack((along, np.cross(radial, along), radial))
            middle = axis + radius * radial + (x + 0.5 * chord) * X
            half = np.array([0.5 * chord / np.cos(tilt), 0.001, 0.5 * (casing - hub) - 0.004])
            bodies.append((f"{row} blade {k + 1}", BoxBody(-half, half, RigidPlacement(middle, frame))))
    turned = 2.0 * np.pi * shift / count
    drift = float(np.tan(stagger))

    def place(x: float, angle: float) -> FloatArray:
        return axis + x * X + radius * np.array([0.0, np.sin(angle), np.cos(angle)])

    inside = drift * chord / radius
    corners = [np.zeros(3), 0.03 * X, place(first, -0.5 * inside), place(first + chord, 0.5 * inside)]
    corners += [place(second, turned + 0.5 * inside), place(second + chord, turned - 0.5 * inside)]
    side = 1.0 if rng.uniform() < 0.5 else -1.0
    angle = turned + side * float(rng.uniform(0.15, 0.5))
    corners.append(place(second + chord + 0.09, angle))
    route = Route.round_corners(np.stack(corners), 0.07)
    return None if route is None else Site(bodies, ((route, route.length),), radius=0.007)


def bays(rng: np.random.Generator, wider: float) -> Site | None:
    """A closed box: in by a hole of its skin, then along it through the holes of its ribs."""
    half = float(rng.uniform(0.09, 0.12))
    hole = 0.012 + wider + float(rng.uniform(0.022, 0.035))
    skin = float(rng.uniform(0.05, 0.1))
    rib = hole
    # The box lies along z; the arm comes in across.
    depth = skin + half
    apart = 0.16 + float(rng.uniform(0.0, 0.03))
    low = -apart + 0.02
    high = 2.4 * apart
    thick = 0.003
    bodies: list[tuple[str, Body]] = [
        ("lower skin", holed_plate(skin * X, X, hole, 0.45)),
        (
            "upper skin",
            box([skin + 2.0 * half, -0.45, -0.45], [skin + 2.0 * half + thick, 0.45, 0.45]),
        ),
        ("front spar", box([skin, -half - thick, low], [skin + 2.0 * half, -half, high])),
        ("rear spar", box([skin, half, low], [skin + 2.0 * half, half + thick, high])),
        ("root rib", box([skin, -half, low - thick], [skin + 2.0 * half, half, low])),
    ]
    z = np.array([0.0, 0.0, 1.0])
    count = int(rng.integers(1, 3))
    corners = [np.zeros(3)]
    for k in range(count):
        aside = rng.uniform(-0.2, 0.2, 2) * half
        place = np.array([depth + aside[0], aside[1], 0.7 * apart + k * apart])
        bodies.append((f"rib {k + 1}", holed_plate(place, z, rib, half - 0.25 * half)))
        corners.append(place)
    turn_at = np.array([corners[1][0], 0.0, 0.0])
    corners = [corners[0], turn_at, *corners[1:]]
    goal = corners[-1] + [*rng.uniform(-0.4, 0.4, 2) * half, float(rng.uniform(0.08, 0.13))]
    route = Route.round_corners(np.stack((*corners, goal)), 0.075)
    return None if route is None else Site(bodies, ((route, route.length),))


def u_turn(rng: np.random.Generator, wider: float) -> Site | None:
    """Past the edge of a wall beside the guide tube, round it, and back on its other side."""
    near = 0.03 + wider + float(rng.uniform(0.0, 0.03))
    thick = float(rng.uniform(0.02, 0.06))
    end = float(rng.uniform(0.2, 0.3))
    across = 2.0 * float(rng.uniform(0.08, 0.12))
    back = float(rng.uniform(0.08, 0.2))
    rise = float(rng.uniform(-0.06, 0.06))
    bodies: list[tuple[str, Body]] = [
        ("wall", box([-0.4, near, -0.5], [end, near + thick, 0.5])),
        ("outer wall", box([-0.4, near + thick + across, -0.5], [end + 0.4, near + thick + across + 0.02, 0.5])),
        ("ceiling", box([0.05, -0.3, 0.12], [end + 0.4, near + thick + across, 0.14])),
        ("ground", box([0.05, -0.3, -0.14], [end + 0.4, near + thick + across, -0.12])),
    ]
    y = near + thick + 0.5 * across
    corner = end + 0.045 + wider
    points = [[0, 0, 0], [corner + 0.5 * y, 0.0, 0.0], [corner + 0.5 * y, y, rise], [end - back, y, rise]]
    route = Route.round_corners(np.array(points), 0.5 * y - 0.002 if abs(rise) < 1e-9 else 0.42 * y)
    return None if route is None or route.length > 0.82 else Site(bodies, ((route, route.length),))


def holes(rng: np.random.Generator, wider: float) -> Site | None:
    """Two or three plates, each with a round hole somewhere else."""
    return _holes(rng, wider, passed=False)


def holes_via(rng: np.random.Generator, wider: float) -> Site | None:
    """The same, the holes named as places to pass."""
    return _holes(rng, wider, passed=True)


def _holes(rng: np.random.Generator, wider: float, *, passed: bool) -> Site | None:
    count = int(rng.integers(2, 4))
    x = float(rng.uniform(0.05, 0.1))
    places = [np.array([x, 0.0, 0.0])]
    for _ in range(count - 1):
        x += float(rng.uniform(0.15, 0.22))
        places.append(np.array([x, *(places[-1][1:] + rng.uniform(-0.09, 0.09, 2))]))
    hole = 0.012 + wider + float(rng.uniform(0.015, 0.035))
    bodies: list[tuple[str, Body]] = [
        (f"plate {k}", holed_plate(place, X, hole, 0.35)) for k, place in enumerate(places, start=1)
    ]
    corners = [np.zeros(3)]
    for place in places:
        corners += [place - 0.02 * X, place + 0.02 * X]
    goal = places[-1] + np.array([rng.uniform(0.1, 0.2), *rng.uniform(-0.12, 0.12, 2)])
    route = Route.round_corners(np.stack((*corners[:1], *corners[2:], goal)), 0.07)
    if route is None:
        return None
    return Site(bodies, ((route, route.length),), via=tuple(places) if passed else ())


def post(rng: np.random.Generator, wider: float) -> Site | None:
    """A fixed base; the goal lies behind a post, or two, pointed back."""
    radius = float(rng.uniform(0.03, 0.07))
    place = np.array([float(rng.uniform(0.3, 0.45)), radius + 0.025 + wider + float(rng.uniform(0.0, 0.02))])
    bodies: list[tuple[str, Body]] = [
        ("post", CylinderBody(np.append(place, -0.6), np.append(place, 0.6), radius)),
        ("wall", box([-0.3, place[1] + radius + 0.25, -0.6], [1.1, place[1] + radius + 0.27, 0.6])),
    ]
    if rng.uniform() < 0.5:
        other = place + np.array([rng.uniform(-0.3, -0.2), rng.uniform(0.1, 0.15)])
        bodies.append(("second post", CylinderBody(np.append(other, -0.6), np.append(other, 0.6), 0.02)))
    round_it = radius + 0.03 + wider + float(rng.uniform(0.01, 0.03))
    far = place[0] + round_it
    y = place[1] + round_it
    back = place[0] - float(rng.uniform(0.0, 0.1))
    rise = float(rng.uniform(-0.15, 0.15))
    corners = np.array([[0, 0, 0], [far, -0.01, 0.3 * rise], [far, y, 0.7 * rise], [back, y, rise]])
    route = Route.round_corners(corners, 0.45 * y)
    if route is None:
        return None
    return _whole_length(bodies, route, 0.5 * float(np.linalg.norm(route.places[-1])) + 0.2, rng)


def _whole_length(bodies: list[tuple[str, Body]], route: Route, width: float, rng: np.random.Generator) -> Site | None:
    """The site of an arm with a fixed base, whose arm is as long as it is: its route has a bow to take up the rest."""
    spare = 0.9 - route.length
    if not 0.005 < spare < 0.3:
        return None
    # A bow of a sine over the first part lengthens it by about (π h / w)² w / 4.
    side = rng.normal(size=3) * np.array([0.0, 1.0, 1.0])
    side[1] = -abs(side[1])
    side /= np.linalg.norm(side)
    low = 0.0
    high = 0.5
    for _ in range(40):
        height = 0.5 * (low + high)
        bowed = _bowed(route, width, height, side)
        if bowed.length < 0.9:
            low = height
        else:
            high = height
    return Site(bodies, ((_bowed(route, width, low, side), 0.9),), fed=False, directed=bool(rng.uniform() < 0.7))


def _bowed(route: Route, width: float, height: float, side: FloatArray) -> Route:
    share = np.clip(route.arcs / width, 0.0, 1.0)
    return Route(route.places + (height * np.sin(np.pi * share) ** 2)[:, None] * side)


def reach_in(rng: np.random.Generator, wider: float) -> Site | None:
    """A fixed base beside a plate; the arm hangs before it and has to reach through its hole."""
    x = float(rng.uniform(0.35, 0.45))
    place = np.array([x, *rng.uniform(-0.1, 0.1, 2)])
    hole = 0.012 + wider + float(rng.uniform(0.025, 0.05))
    bodies: list[tuple[str, Body]] = [("plate", holed_plate(place, X, hole, 0.5))]
    goal = place + np.array([rng.uniform(0.15, 0.3), *rng.uniform(-0.1, 0.1, 2)])
    route = Route.round_corners(np.stack((np.zeros(3), place - 0.04 * X, place + 0.04 * X, goal)), 0.08)
    turn = rng.uniform(0.0, 2.0 * np.pi)
    across = np.array([0.0, np.cos(turn), np.sin(turn)])
    aside = Route.round_corners(
        np.stack((np.zeros(3), 0.12 * X, 0.12 * X + 0.4 * across, -0.3 * X + 0.4 * across)), 0.1
    )
    if route is None or aside is None:
        return None
    site = _whole_length(bodies, route, x - 0.05, rng)
    if site is None:
        return None
    return Site(bodies, ((aside, 0.9), *site.routes), fed=False, directed=site.directed)


def other_hole(rng: np.random.Generator, wider: float) -> Site | None:
    """The arm stands in one of two holes of a plate and has to go into the other: back first."""
    x = float(rng.uniform(0.2, 0.3))
    apart = 0.5 * float(rng.uniform(0.1, 0.16))
    half = 0.015 + wider + float(rng.uniform(0.015, 0.025))
    if apart < half + 0.01:
        return None
    bodies: list[tuple[str, Body]] = []
    # A plate with two square holes, of five bars.
    for name, low, high in (
        ("plate above", [half, -0.4], [0.4, 0.4]),
        ("plate below", [-0.4, -0.4], [-half, 0.4]),
        ("plate, right", [-half, -0.4], [half, -apart - half]),
        ("plate between the holes", [-half, -apart + half], [half, apart - half]),
        ("plate, left", [-half, apart + half], [half, 0.4]),
    ):
        bodies.append((name, box([x, low[1], low[0]], [x + 0.004, high[1], high[0]])))
    routes = []
    for side in (-1.0, 1.0):
        place = np.array([x, side * apart, 0.0])
        goal = place + np.array([rng.uniform(0.12, 0.3), *rng.uniform(-0.1, 0.1, 2)])
        route = Route.round_corners(np.stack((np.zeros(3), 0.03 * X, place - 0.03 * X, place + 0.03 * X, goal)), 0.08)
        if route is None:
            return None
        routes.append((route, route.length))
    return Site(bodies, tuple(routes))


SITES: Mapping[str, Callable[[np.random.Generator, float], Site | None]] = {
    "pipe-two-bends": space_ducts.pipe_of_two_bends,
    "pipe-three-bends": space_ducts.pipe_of_three_bends,
    "tee": space_ducts.tee,
    "tee-pose": space_ducts.tee_pose,
    "tank": space_ducts.tank,
    "hairpin": space_ducts.hairpin,
    "double-back": space_ducts.double_back,
    "u-turn": u_turn,
    "holes": holes,
    "holes-via": holes_via,
    "post": post,
    "reach-in": reach_in,
    "other-hole": other_hole,
    "other-branch": space_ducts.other_branch,
    "frames": frames,
    "blades": blades,
    "bays": bays,
}
"""What draws a site with a given extra room, or None where the draw is of no use."""
LENGTH = 0.9
"""Of the arms [m]."""
TRAVEL = 0.85
"""Of the feed axes [m]."""
SHOWN = 0.02
"""Of a fed arm at the start, beyond its guide tube [m]."""
LEAST_GAP = 0.004
"""Of the arm along the known way [m]."""
BEND_RADIUS = 0.1
"""For which openings are widened where links are long [m]."""
MOST_DRAWS = 400
"""After so many draws of no use something is wrong with a family."""


def site_problem(family: str, seed: int, links: int, name: str) -> Problem:
    """A problem of a family.

    Args:
        family: its name.
        seed: of the draws.
        links: of the arm.
        name: of the problem.

    Raises:
        ProblemError: no scene with room for such an arm was drawn.
    """
    rng = np.random.default_rng([seed, sum(map(ord, family))])
    # Half of what the chord of a link cuts off a bend, once on each side.
    wider = (LENGTH / links) ** 2 / (8.0 * BEND_RADIUS)
    for _ in range(MOST_DRAWS):
        site = SITES[family](rng, wider)
        if site is None:
            continue
        problem = _problem(site, links, name)
        if problem is not None:
            return problem if seed % 2 == 0 else _turned(problem, _rotation(rng))
    raise ProblemError(f"no scene of the family {family} leaves an arm of {links} links its room")


def _problem(site: Site, links: int, name: str) -> Problem | None:
    """The problem of a site; None where the arm cannot lie along its routes."""
    arm = replace(arm_of_links(links, LENGTH, site.radius), mount_length=site.radius)
    if site.fed:
        # The guide tube ends at the origin.
        outside = LENGTH - SHOWN
        arm = replace(arm, base=np.array([-outside, 0.0, 0.0]), feed=Feed(0.0, TRAVEL, outside))
    soup_of = Workspace(bounds=None, obstacles=tuple(Obstacle(name, body) for name, body in site.bodies))
    tree = SurfaceTree.of(soup_of.soup)
    ends = []
    for route, end in site.routes:
        q = laid_along(arm, route, end)
        if q is None or not _free(tree, arm, q):
            return None
        ends.append(q)
    goal = ends[-1]
    straight = np.append(np.zeros(2 * links), [0.0] * len(arm.base_axes))
    start = ends[0] if len(ends) > 1 else straight
    if not _free(tree, arm, start):
        return None
    position = arm.joint_positions_at(goal)[-1]
    direction = arm.link_rotations(goal)[-1, :, 0] if site.directed else None
    tip = TipGoal(position, direction, site.via)
    rates = np.ones(3 * links)
    limits = (
        Limits(rates, 4.0 * rates, feed_velocity=0.1, feed_acceleration=0.5) if site.fed else Limits(rates, 4.0 * rates)
    )
    return Problem(
        name,
        soup_of,
        arm,
        limits,
        JointPose.from_configuration(start, arm.coordinates),
        JointPose.from_configuration(goal, arm.coordinates) if site.whole_pose else tip,
    )


def _free(tree: SurfaceTree, arm: Arm, q: FloatArray) -> bool:
    """Whether a configuration keeps the least gap from bodies, and links from each other."""
    points = arm.joint_positions_at(q)
    first = int(np.ceil(arm.mount_length / arm.link_length))
    axes = np.stack((points[first:-1], points[first + 1 :]), axis=1)
    i, j = arm.distant_pairs
    apart = segment_distances(points[i], points[i + 1], points[j], points[j + 1])[2]
    kept = arm.radius + LEAST_GAP
    return bool(tree.distances(axes, 2.0 * kept).min() > kept and np.all(apart > 2.0 * kept))


def _rotation(rng: np.random.Generator) -> RigidPlacement:
    return RigidPlacement.of_quaternion(rng.uniform(-0.3, 0.3, 3), rng.normal(size=4))


def _turned(problem: Problem, by: RigidPlacement) -> Problem:
    """The problem with everything in it moved."""
    arm = problem.arm
    turned = by.rotation
    workspace = replace(
        problem.workspace,
        obstacles=tuple(Obstacle(each.name, _moved(each.body, by)) for each in problem.workspace.obstacles),
    )
    goal = problem.goal
    if isinstance(goal, TipGoal):
        direction = None if goal.direction is None else turned @ goal.direction
        via = tuple(by.points(place[None])[0] for place in goal.via)
        goal = TipGoal(by.points(goal.position[None])[0], direction, via)
    base = by.points(arm.base[None])[0]
    moved = replace(arm, base=base, direction=turned @ arm.direction, up=turned @ arm.up)
    return replace(problem, workspace=workspace, arm=moved, goal=goal)


def _moved(body: Body, by: RigidPlacement) -> Body:
    if isinstance(body, BoxBody):
        own = body.placement
        return replace(body, placement=RigidPlacement(by.points(own.position[None])[0], by.rotation @ own.rotation))
    if isinstance(body, SphereBody):
        return replace(body, center=by.points(body.center[None])[0])
    if isinstance(body, (CapsuleBody, CylinderBody)):
        start, end = by.points(np.stack((body.start, body.end)))
        return replace(body, start=start, end=end)
    return replace(body, vertices=by.points(body.vertices), placement=by)
