"""Random ducts in space."""

import hashlib

import numpy as np

from ccm_opt.cli.compare.space_clutter import Route, Site
from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.scene.bodies import Body, BoxBody, MeshBody

SIDES = 32
"""Of pipes and holes, so that a pipe of 50 mm is within 0.3 mm of round."""


def pipe(route: Route, low: float, high: float, radius: float) -> MeshBody:
    """The wall of a pipe about a part of a route, open at both ends.

    Args:
        route: along its middle.
        low: arc length at which it begins [m].
        high: arc length at which it ends [m].
        radius: of its inside, which the corners of the mesh lie on [m].
    """
    middles = route.part(low, high)[::3]
    tangents = np.gradient(middles, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    across = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
    angles = 2.0 * np.pi / SIDES * np.arange(SIDES)[:, None]
    rings = []
    for middle, tangent in zip(middles, tangents, strict=True):
        # The frame is carried along, so that the mesh does not twist.
        across = across - (across @ tangent) * tangent
        across /= np.linalg.norm(across)
        rings.append(middle + radius * (np.cos(angles) * across + np.sin(angles) * np.cross(tangent, across)))
    return sheet(np.concatenate(rings), _bands(len(rings)))


def straight_pipe(start: FloatArray, end: FloatArray, radius: float) -> MeshBody:
    """The wall of a straight pipe, open at both ends."""
    length = float(np.linalg.norm(end - start))
    return pipe(Route(np.stack((start, end))), 0.0, length, radius)


def holed_plate(middle: FloatArray, normal: FloatArray, hole: float, half: float) -> MeshBody:
    """A square plate with a round hole in its middle, a sheet.

    Args:
        middle: of the hole, shape (3,) [m].
        normal: of the plate, a unit vector, shape (3,).
        hole: radius of the hole [m].
        half: half the side of the plate [m].
    """
    angles = 2.0 * np.pi / SIDES * np.arange(SIDES)
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    square = circle / np.max(np.abs(circle), axis=1)[:, None]
    rays = np.concatenate((hole * circle, half * square))
    return _lifted(rays, middle, normal)


def ring(middle: FloatArray, normal: FloatArray, inner: float, outer: float) -> MeshBody:
    """A flat ring, a sheet, such as a frame of a fuselage."""
    angles = 2.0 * np.pi / SIDES * np.arange(SIDES)
    circle = np.column_stack((np.cos(angles), np.sin(angles)))
    return _lifted(np.concatenate((inner * circle, outer * circle)), middle, normal)


def sheet(vertices: FloatArray, faces: IntArray) -> MeshBody:
    """A mesh with the file that it could have come from, so that a problem with it can be written."""
    vertices = vertices.astype(np.float32).astype(np.float64)  # as the file has them
    content = _binary_stl(vertices[faces])
    digest = hashlib.sha256(content).hexdigest()
    return MeshBody(vertices, faces, "sheet.stl", digest, solid=False, content=content, triangles_read=len(faces))


def _lifted(plane: FloatArray, middle: FloatArray, normal: FloatArray) -> MeshBody:
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    across /= np.linalg.norm(across)
    vertices = middle + plane[:, :1] * across + plane[:, 1:] * np.cross(normal, across)
    return sheet(vertices, _bands(2))


def _bands(rings: int) -> IntArray:
    """Triangles between rings of ``SIDES`` vertices each, one after the other."""
    here = np.arange(SIDES)
    after = np.roll(here, -1)
    band = np.concatenate(
        (np.column_stack((here, after, after + SIDES)), np.column_stack((here, after + SIDES, here + SIDES)))
    )
    return np.concatenate([band + k * SIDES for k in range(rings - 1)])


def _binary_stl(triangles: FloatArray) -> bytes:
    rows = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("kind", "<u2")])
    rows["corners"] = triangles
    return b"\0" * 80 + np.uint32(len(triangles)).tobytes() + rows.tobytes()


THICK = 0.003
"""Of sheet metal [m]."""
X = np.array([1.0, 0.0, 0.0])


def pipe_of_two_bends(rng: np.random.Generator, wider: float) -> Site | None:
    """A pipe with two bends in planes of their own, and a look aside beyond its end."""
    return _bent_pipe(rng, wider, 2)


def pipe_of_three_bends(rng: np.random.Generator, wider: float) -> Site | None:
    """A pipe with three bends in planes of their own; the goal is just beyond its end."""
    return _bent_pipe(rng, wider, 3)


def _bent_pipe(rng: np.random.Generator, wider: float, bends: int) -> Site | None:
    radius = float(rng.uniform(0.09, 0.14))
    turns = rng.uniform(0.7, 1.7, bends)
    corners = [np.zeros(3)]
    way = X
    cut = 0.0
    for turn in turns:
        next_cut = radius * np.tan(0.5 * turn)
        corners.append(corners[-1] + (cut + next_cut + rng.uniform(0.02, 0.1)) * way)
        way = _bent(way, turn, rng)
        cut = next_cut
    corners.append(corners[-1] + (cut + rng.uniform(0.03, 0.1)) * way)
    through = Route.round_corners(np.stack(corners), radius)
    if through is None or through.length > 0.68:
        return None
    # Beyond the end the arm looks aside.
    aside = _bent(way, float(rng.uniform(0.1, 0.9)), rng)
    corner = corners[-1] + 0.06 * way
    route = Route.round_corners(np.stack((*corners[:-1], corner, corner + 0.12 * aside)), radius)
    if route is None:
        return None
    inner = 0.012 + wider + float(rng.uniform(0.012, 0.03))
    if not _keeps_off_itself(through, 2.0 * inner + 0.03):
        return None
    bodies: list[tuple[str, Body]] = [("pipe", pipe(through, 0.02, through.length, inner))]
    return Site(bodies, ((route, route.length),), directed=bool(rng.uniform() < 0.7))


def tee(rng: np.random.Generator, wider: float) -> Site | None:
    """A square duct with a square branch, into which the arm has to turn."""
    return _into_branch(rng, wider, whole_pose=False)


def tee_pose(rng: np.random.Generator, wider: float) -> Site | None:
    """The same to a pose of all joints."""
    return _into_branch(rng, wider, whole_pose=True)


def _into_branch(rng: np.random.Generator, wider: float, *, whole_pose: bool) -> Site | None:
    bodies, route, _ = _tee(rng, wider)
    if route is None:
        return None
    return Site(bodies, ((route, route.length - float(rng.uniform(0.0, 0.06))),), whole_pose=whole_pose)


def other_branch(rng: np.random.Generator, wider: float) -> Site | None:
    """The arm stands in one arm of a tee and has to go into the other: back first."""
    bodies, route, on = _tee(rng, wider)
    if route is None or on is None:
        return None
    ends = ((route, route.length - 0.02), (on, on.length - 0.02))
    return Site(bodies, ends if rng.uniform() < 0.5 else ends[::-1])


def _tee(rng: np.random.Generator, wider: float) -> tuple[list[tuple[str, Body]], Route | None, Route | None]:
    half = 0.012 + wider + float(rng.uniform(0.016, 0.035))
    at = float(rng.uniform(0.2, 0.35))
    end = at + float(rng.uniform(0.15, 0.3))
    reach = half + float(rng.uniform(0.12, 0.25))
    t = THICK
    w = half
    walls = {
        "left side": ([0.02, w, -w], [end, w + t, w]),
        "right side": ([0.02, -w - t, -w], [end, -w, w]),
        "floor": ([0.02, -w - t, -w - t], [end, w + t, -w]),
        "roof before the branch": ([0.02, -w - t, w], [at - w, w + t, w + t]),
        "roof behind the branch": ([at + w, -w - t, w], [end, w + t, w + t]),
        "branch, left side": ([at - w, w, w], [at + w, w + t, reach]),
        "branch, right side": ([at - w, -w - t, w], [at + w, -w, reach]),
        "branch, near side": ([at - w - t, -w - t, w], [at - w, w + t, reach]),
        "branch, far side": ([at + w, -w - t, w], [at + w + t, w + t, reach]),
    }
    bodies: list[tuple[str, Body]] = [(name, box(*corners)) for name, corners in walls.items()]
    up = float(rng.uniform(0.0, 0.5)) * w
    goal = np.array([at - up, 0.0, reach + float(rng.uniform(-0.05, 0.08))])
    corners = np.array([[0.0, 0.0, 0.0], [at - up, 0.0, 0.0], goal])
    route = Route.round_corners(corners, float(rng.uniform(0.06, 0.1)))
    on = Route.round_corners(np.array([[0.0, 0.0, 0.0], [end + 0.1, 0.0, 0.0]]), 0.1)
    return bodies, route, on


def tank(rng: np.random.Generator, wider: float) -> Site | None:
    """A tank that is entered by a nozzle, with baffles that reach from below and from above in turn."""
    nozzle = 0.012 + wider + float(rng.uniform(0.012, 0.025))
    mouth = float(rng.uniform(0.08, 0.15))
    half = float(rng.uniform(0.14, 0.2))
    long = float(rng.uniform(0.42, 0.55))
    far = mouth + long
    bodies: list[tuple[str, Body]] = [
        ("nozzle", straight_pipe(0.02 * X, mouth * X, nozzle)),
        ("front of the tank", holed_plate(mouth * X, X, nozzle, half)),
        ("back of the tank", box([far, -half, -half], [far + THICK, half, half])),
        ("left side", box([mouth, half, -half], [far, half + THICK, half])),
        ("right side", box([mouth, -half - THICK, -half], [far, -half, half])),
        ("bottom", box([mouth, -half, -half - THICK], [far, half, -half])),
        ("top", box([mouth, -half, half], [far, half, half + THICK])),
    ]
    count = int(rng.integers(1, 3))
    gap = 0.05 + 2.0 * wider + float(rng.uniform(0.0, 0.04))
    side = 1.0 if rng.uniform() < 0.5 else -1.0
    corners = [np.zeros(3)]
    places = mouth + long * (np.arange(count) + 1.0) / (count + 1.0)
    aside = 0.0
    for place in places:
        edge = side * (half - gap)
        low, high = sorted((-side * half, edge))
        bodies.append((f"baffle {len(corners)}", box([place, -half, low], [place + THICK, half, high])))
        aside += float(rng.uniform(-0.03, 0.03))
        corners.append(np.array([place, aside, side * (half - 0.5 * gap)]))
        side = -side
    goal = np.array(
        [far - rng.uniform(0.04, 0.08), aside + rng.uniform(-0.06, 0.06), side * rng.uniform(0.0, 0.5) * half]
    )
    # Straight out of the nozzle, over every baffle level, then to the goal.
    first = (mouth + 0.01) * X
    points = [corners[0], first]
    for corner in corners[1:]:
        points += [corner - 0.03 * X, corner + 0.03 * X]
    route = Route.round_corners(np.stack((*points, goal)), 0.06)
    return None if route is None else Site(bodies, ((route, route.length),), directed=bool(rng.uniform() < 0.5))


def hairpin(rng: np.random.Generator, wider: float) -> Site | None:
    """Two slots side by side, joined at the far end: in by the one, round, and back by the other."""
    return _slots(rng, wider, 1)


def double_back(rng: np.random.Generator, wider: float) -> Site | None:
    """Three slots side by side, joined at alternate ends: in, back, and in again."""
    return _slots(rng, wider, 2)


def _slots(rng: np.random.Generator, wider: float, turns: int) -> Site | None:
    apart = 2.0 * float(rng.uniform(0.075, 0.1 if turns > 1 else 0.12))
    wide = min(0.5 * apart - THICK, 0.03 + wider + float(rng.uniform(0.0, 0.02)))
    long = float(rng.uniform(0.2, 0.28 if turns > 1 else 0.36))
    end = 0.02 + long
    deep = wide
    bodies: list[tuple[str, Body]] = []
    left = turns * apart + wide
    for k in range(turns + 1):
        middle = k * apart
        for side, name in ((-1.0, "right"), (1.0, "left")):
            y = middle + side * wide
            low, high = sorted((y, y + side * THICK))
            # Partitions end before the slot does, alternately at its far and its near end.
            inner_far = (side > 0.0 and k < turns and k % 2 == 0) or (side < 0.0 and k % 2 == 1)
            inner_near = (side > 0.0 and k < turns and k % 2 == 1) or (side < 0.0 and k > 0 and k % 2 == 0)
            begin = 0.02 + (2.0 * wide if inner_near else 0.0)
            finish = end - (2.0 * wide if inner_far else 0.0)
            if k > 0 and not inner_near and turns == 1:
                begin = 0.02
            bodies.append((f"{name} wall of slot {k + 1}", box([begin, low, -deep], [finish, high, deep])))
    bodies.append(("far end", box([end, -wide, -deep], [end + THICK, left, deep])))
    if turns > 1:
        bodies.append(("near end", box([0.017, wide + 0.005, -deep], [0.02, left - 2.0 * wide, deep])))
    bodies.append(("floor", box([0.02, -wide - THICK, -deep - THICK], [end, left + THICK, -deep])))
    bodies.append(("roof", box([0.02, -wide - THICK, deep], [end, left + THICK, deep + THICK])))
    far = end - wide
    near = 0.02 + wide
    corners = [np.zeros(3)]
    for k in range(turns):
        x = far if k % 2 == 0 else near
        corners += [np.array([x, k * apart, 0.0]), np.array([x, (k + 1) * apart, 0.0])]
    back = far - float(rng.uniform(0.1, long - 0.06)) if turns % 2 else near + float(rng.uniform(0.08, 0.16))
    corners.append(np.array([back, turns * apart, 0.0]))
    route = Route.round_corners(np.stack(corners), 0.5 * apart - 1e-6)
    return None if route is None or route.length > 0.8 else Site(bodies, ((route, route.length),))


def box(low: object, high: object) -> BoxBody:
    """A box between two corners, shape (3,) each [m]."""
    return BoxBody(np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64))


def _bent(way: FloatArray, turn: float, rng: np.random.Generator) -> FloatArray:
    """A direction turned by an angle towards a random side."""
    side = rng.normal(size=3)
    side -= (side @ way) * way
    side /= np.linalg.norm(side)
    return np.asarray(np.cos(turn) * way + np.sin(turn) * side)


def _keeps_off_itself(route: Route, apart: float) -> bool:
    places = route.part(0.0, route.length)[::4]
    arcs = np.linspace(0.0, route.length, len(places))
    distant = np.abs(arcs[:, None] - arcs) > 1.8 * apart
    between = np.linalg.norm(places[:, None] - places, axis=2)
    behind = places[np.linspace(0.0, route.length, len(places)) > apart]
    # The guide tube, and what it is mounted on, lie behind the origin.
    return bool(
        np.all(between[distant] > apart) and np.all((behind[:, 0] > 0.0) | (np.hypot(*behind[:, 1:].T) > apart))
    )
