"""Walls and posts for snake arms: round the edge of a wall, through holes, behind a post, from one hole to another."""

import numpy as np

from ccm_opt.comparison.space_routes import Route
from ccm_opt.comparison.space_shells import holed_plate
from ccm_opt.comparison.space_site import Site
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.scene.bodies import Body, BoxBody, CylinderBody

X = np.array([1.0, 0.0, 0.0])


def u_turn(rng: np.random.Generator, wider: float) -> Site | None:
    """Past the edge of a wall beside the guide tube, round it, and back on its other side."""
    near = 0.03 + wider + float(rng.uniform(0.0, 0.03))
    thick = float(rng.uniform(0.02, 0.06))
    end = float(rng.uniform(0.2, 0.3))
    across = 2.0 * float(rng.uniform(0.08, 0.12))
    back = float(rng.uniform(0.08, 0.2))
    rise = float(rng.uniform(-0.06, 0.06))
    bodies: list[tuple[str, Body]] = [
        ("wall", _box([-0.4, near, -0.5], [end, near + thick, 0.5])),
        ("outer wall", _box([-0.4, near + thick + across, -0.5], [end + 0.4, near + thick + across + 0.02, 0.5])),
        ("ceiling", _box([0.05, -0.3, 0.12], [end + 0.4, near + thick + across, 0.14])),
        ("ground", _box([0.05, -0.3, -0.14], [end + 0.4, near + thick + across, -0.12])),
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
        ("wall", _box([-0.3, place[1] + radius + 0.25, -0.6], [1.1, place[1] + radius + 0.27, 0.6])),
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
        bodies.append((name, _box([x, low[1], low[0]], [x + 0.004, high[1], high[0]])))
    routes = []
    for side in (-1.0, 1.0):
        place = np.array([x, side * apart, 0.0])
        goal = place + np.array([rng.uniform(0.12, 0.3), *rng.uniform(-0.1, 0.1, 2)])
        route = Route.round_corners(np.stack((np.zeros(3), 0.03 * X, place - 0.03 * X, place + 0.03 * X, goal)), 0.08)
        if route is None:
            return None
        routes.append((route, route.length))
    return Site(bodies, tuple(routes))


def _box(low: object, high: object) -> BoxBody:
    return BoxBody(np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64))
