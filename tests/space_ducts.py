"""Random scenes in space in which an arm has to pass ducts.

Each family is a function that returns random bodies and paths among them. Its argument ``wider`` is the length [m] by
which half the width of openings is increased for arms with long links. An invalid scene raises ``UselessDraw``.
"""

from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray

from .space_shapes import ORIGIN, THICK, Bodies, Route, UselessDraw, X, box, holed_plate, pipe, straight_pipe, unit


@dataclass(frozen=True, eq=False)
class Site:
    """Bodies and paths among them, with the end of a fed arm's guide tube, or the base of a fixed arm, at the origin.

    Guide tube and base are directed along x.

    Attributes:
        bodies: bodies by name.
        routes: path on which the arm lies at the goal, with the arc length of the tip [m]; of two paths, the first is
            for the start.
        fed: whether the arm has a feed axis.
        directed: whether the goal has a direction.
        whole_pose: whether the goal is a pose of all joints.
        via: via points of the tip, each of shape (3,) [m].
        radius: radius of the arm [m].
    """

    bodies: Bodies
    routes: tuple[tuple[Route, float], ...]
    fed: bool = True
    directed: bool = True
    whole_pose: bool = False
    via: tuple[FloatArray, ...] = ()
    radius: float = 0.012


def bent_pipe(rng: np.random.Generator, wider: float, bends: int) -> Site:
    """Return a scene with a pipe with bends in different planes, and a goal beyond its end, pointing sideways."""
    radius = float(rng.uniform(0.09, 0.14))
    corners = [ORIGIN]
    way = X
    cut = 0.0
    for turn in rng.uniform(0.7, 1.7, bends):
        next_cut = radius * np.tan(0.5 * turn)
        corners.append(corners[-1] + (cut + next_cut + rng.uniform(0.02, 0.1)) * way)
        way = _bent(way, turn, rng)
        cut = next_cut
    corners.append(corners[-1] + (cut + rng.uniform(0.03, 0.1)) * way)
    through = Route.round_corners(np.stack(corners), radius)
    if through.length > 0.68:
        raise UselessDraw
    # Beyond the end the arm looks aside.
    aside = _bent(way, float(rng.uniform(0.1, 0.9)), rng)
    corner = corners[-1] + 0.06 * way
    route = Route.round_corners(np.stack((*corners[:-1], corner, corner + 0.12 * aside)), radius)
    inner = 0.012 + wider + float(rng.uniform(0.012, 0.03))
    _refuse_near_itself(through, 2.0 * inner + 0.03)
    bodies: Bodies = {"pipe": pipe(through, 0.02, through.length, inner)}
    return Site(bodies, ((route, route.length),), directed=bool(rng.uniform() < 0.7))


def _bent(way: FloatArray, turn: float, rng: np.random.Generator) -> FloatArray:
    """Return a unit vector rotated by an angle [rad] to a random side."""
    side = rng.normal(size=3)
    side = unit(side - (side @ way) * way)
    return np.asarray(np.cos(turn) * way + np.sin(turn) * side)


def _refuse_near_itself(route: Route, apart: float) -> None:
    """Check that a pipe is at a distance [m] from itself and from guide tube and mount, which are behind the origin.

    Raises:
        UselessDraw: the pipe is nearer.
    """
    places = route.part(0.0, route.length)[::4]
    arcs = np.linspace(0.0, route.length, len(places))
    between = np.linalg.norm(places[:, None] - places, axis=2)[np.abs(arcs[:, None] - arcs) > 1.8 * apart]
    behind = places[arcs > apart]
    if np.any(between <= apart) or np.any((behind[:, 0] <= 0.0) & (np.hypot(*behind[:, 1:].T) <= apart)):
        raise UselessDraw


def tee(rng: np.random.Generator, wider: float, *, whole_pose: bool) -> Site:
    """Return a scene with a square duct with a branch, into which the arm has to turn."""
    bodies, route, _ = _tee(rng, wider)
    return Site(bodies, ((route, route.length - float(rng.uniform(0.0, 0.06))),), whole_pose=whole_pose)


def other_branch(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene with an arm in one branch of a tee that has to retract and move into the other."""
    bodies, *routes = _tee(rng, wider)
    one, other = ((route, route.length - 0.02) for route in routes)
    return Site(bodies, (one, other) if rng.uniform() < 0.5 else (other, one))


def _tee(rng: np.random.Generator, wider: float) -> tuple[Bodies, Route, Route]:
    """Return the bodies of a tee, the path into the branch, and the path straight on."""
    w = 0.012 + wider + float(rng.uniform(0.016, 0.035))
    at = float(rng.uniform(0.2, 0.35))
    end = at + float(rng.uniform(0.15, 0.3))
    reach = w + float(rng.uniform(0.12, 0.25))
    t = THICK
    bodies: Bodies = {
        "left side": box([0.02, w, -w], [end, w + t, w]),
        "right side": box([0.02, -w - t, -w], [end, -w, w]),
        "floor": box([0.02, -w - t, -w - t], [end, w + t, -w]),
        "roof before the branch": box([0.02, -w - t, w], [at - w, w + t, w + t]),
        "roof behind the branch": box([at + w, -w - t, w], [end, w + t, w + t]),
        "branch, left side": box([at - w, w, w], [at + w, w + t, reach]),
        "branch, right side": box([at - w, -w - t, w], [at + w, -w, reach]),
        "branch, near side": box([at - w - t, -w - t, w], [at - w, w + t, reach]),
        "branch, far side": box([at + w, -w - t, w], [at + w + t, w + t, reach]),
    }
    x = at - float(rng.uniform(0.0, 0.5)) * w
    corners = np.array([ORIGIN, x * X, [x, 0.0, reach + float(rng.uniform(-0.05, 0.08))]])
    route = Route.round_corners(corners, float(rng.uniform(0.06, 0.1)))
    return bodies, route, Route.round_corners(np.stack((ORIGIN, (end + 0.1) * X)), 0.1)


def tank(rng: np.random.Generator, wider: float) -> Site:
    """Return a scene with a tank with an entry nozzle and one or two baffles, from below and above alternately."""
    nozzle = 0.012 + wider + float(rng.uniform(0.012, 0.025))
    mouth = float(rng.uniform(0.08, 0.15))
    half = float(rng.uniform(0.14, 0.2))
    long = float(rng.uniform(0.42, 0.55))
    far = mouth + long
    bodies: Bodies = {
        "nozzle": straight_pipe(0.02 * X, mouth * X, nozzle),
        "front of the tank": holed_plate(mouth * X, X, nozzle, half),
        "back of the tank": box([far, -half, -half], [far + THICK, half, half]),
        "left side": box([mouth, half, -half], [far, half + THICK, half]),
        "right side": box([mouth, -half - THICK, -half], [far, -half, half]),
        "bottom": box([mouth, -half, -half - THICK], [far, half, -half]),
        "top": box([mouth, -half, half], [far, half, half + THICK]),
    }
    count = int(rng.integers(1, 3))
    gap = 0.05 + 2.0 * wider + float(rng.uniform(0.0, 0.04))
    side = 1.0 if rng.uniform() < 0.5 else -1.0
    # Straight out of the nozzle, over every baffle level, then to the goal.
    points = [ORIGIN, (mouth + 0.01) * X]
    aside = 0.0
    for number, place in enumerate(mouth + long * (np.arange(count) + 1.0) / (count + 1.0), start=1):
        low, high = sorted((-side * half, side * (half - gap)))
        bodies[f"baffle {number}"] = box([place, -half, low], [place + THICK, half, high])
        aside += float(rng.uniform(-0.03, 0.03))
        over = np.array([place, aside, side * (half - 0.5 * gap)])
        points += [over - 0.03 * X, over + 0.03 * X]
        side = -side
    goal = [far - rng.uniform(0.04, 0.08), aside + rng.uniform(-0.06, 0.06), side * rng.uniform(0.0, 0.5) * half]
    route = Route.round_corners(np.stack((*points, goal)), 0.06)
    return Site(bodies, ((route, route.length),), directed=bool(rng.uniform() < 0.5))


def slots(rng: np.random.Generator, wider: float, turns: int) -> Site:
    """Return a scene with parallel slots joined at alternate ends, through which the arm moves forth and back."""
    apart = 2.0 * float(rng.uniform(0.075, 0.1 if turns > 1 else 0.12))
    wide = min(0.5 * apart - THICK, 0.03 + wider + float(rng.uniform(0.0, 0.02)))
    long = float(rng.uniform(0.2, 0.28 if turns > 1 else 0.36))
    end = 0.02 + long
    left = turns * apart + wide
    bodies: Bodies = {}
    for k in range(turns + 1):
        for side, name in ((-1, "right"), (1, "left")):
            y = k * apart + side * wide
            low, high = sorted((y, y + side * THICK))
            # Partitions end before the slot does, alternately at its far and its near end.
            partition = k + min(side, 0)
            inner = 0 <= partition < turns
            begin = 0.02 + (2.0 * wide if inner and partition % 2 else 0.0)
            finish = end - (2.0 * wide if inner and partition % 2 == 0 else 0.0)
            bodies[f"{name} wall of slot {k + 1}"] = box([begin, low, -wide], [finish, high, wide])
    bodies["far end"] = box([end, -wide, -wide], [end + THICK, left, wide])
    if turns > 1:
        bodies["near end"] = box([0.017, wide + 0.005, -wide], [0.02, left - 2.0 * wide, wide])
    bodies["floor"] = box([0.02, -wide - THICK, -wide - THICK], [end, left + THICK, -wide])
    bodies["roof"] = box([0.02, -wide - THICK, wide], [end, left + THICK, wide + THICK])
    far, near = end - wide, 0.02 + wide
    corners = [[0.0, 0.0, 0.0]]
    for k in range(turns):
        x = near if k % 2 else far
        corners += [[x, k * apart, 0.0], [x, (k + 1) * apart, 0.0]]
    back = far - float(rng.uniform(0.1, long - 0.06)) if turns % 2 else near + float(rng.uniform(0.08, 0.16))
    route = Route.round_corners(np.array([*corners, [back, turns * apart, 0.0]]), 0.5 * apart - 1e-6)
    if route.length > 0.8:
        raise UselessDraw
    return Site(bodies, ((route, route.length),))
