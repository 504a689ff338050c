"""Families of scenes drawn around a witness: through holes, pipes and pockets."""

from itertools import pairwise

import numpy as np

from ccm_opt.core.arrays import FloatArray

from .space_shapes import (
    ORIGIN,
    Route,
    UselessDraw,
    X,
    bands,
    box,
    joined_pipes,
    outline_about,
    rings_along,
    sheet,
    thick_pipe,
    thick_plate,
    thick_tube,
    unit,
)
from .witness_drawing import IN_TUBE, Drawing
from .witness_motions import Swept, followed, meander

Y, Z = np.eye(3)[1:]
STEP_OF_HELIX = 0.04
"""Angle between the points of a helical path [rad]."""


def ribs(scene: Drawing) -> None:
    """Through an access hole of a wing box, then along it through the holes of its ribs."""
    rng, lead, bend = scene.rng, scene.lead(), scene.bend()
    scene.length, scene.radius = float(rng.uniform(1.2, 1.5)), float(rng.uniform(0.011, 0.014))
    lead, bend = scene.lead(), scene.bend()
    x, high = lead + bend, lead + bend + float(rng.uniform(0.07, 0.12))
    count = int(rng.integers(2, 5))
    first, apart = bend + float(rng.uniform(0.04, 0.08)), float(rng.uniform(0.18, 0.24))
    holes = [
        np.array([x + rng.uniform(-0.04, 0.03), first + k * apart, rng.uniform(-0.06, 0.06)]) for k in range(count)
    ]
    goal = holes[-1] + np.array([rng.uniform(-0.04, 0.04), rng.uniform(0.08, 0.15), rng.uniform(-0.05, 0.05)])
    route = Route.round_corners(np.stack((ORIGIN, x * X, *holes, goal)), bend)
    swept = scene.go(route)
    end, half = goal[1] + 0.2, 0.22
    scene.plate("lower skin", 0.001 * X, X, swept, 0.25)
    for k, hole in enumerate(holes):
        scene.plate(f"rib {k + 1}", hole, Y, swept, 0.2)
    scene.bodies |= {
        "lower skin, aft": box([0.0, 0.251, -half], [0.003, end, half]),
        "upper skin": box([high, -0.25, -half], [high + 0.004, end, half]),
        "spar -1": box([0.0, -0.25, -half - 0.006], [high, end, -half]),
        "spar 1": box([0.0, -0.25, half], [high, end, half + 0.006]),
        **{f"stringer {s}": box([high - 0.025, 0.06, s * 0.11], [high, end, s * 0.11 + 0.004]) for s in (-1, 1)},
    }


def pipes(scene: Drawing) -> None:
    """Through a network of pipes with elbows and tees."""
    rng, lead, bend = scene.rng, scene.lead(), scene.bend()
    scene.length = 1.0
    corners, way, cut = [ORIGIN], X, 0.0
    for k in range(int(rng.integers(2, 4))):
        corners.append(corners[-1] + (cut + bend + (lead if k == 0 else rng.uniform(0.02, 0.1))) * way)
        side = unit(np.cross(way, rng.normal(size=3)))
        way, cut = side, bend
    corners.append(corners[-1] + (cut + rng.uniform(0.05, 0.12)) * way)
    route = Route.round_corners(np.stack(corners), bend - 1e-6)
    swept = scene.go(route)
    end = route.length + 0.03
    wide = swept.width(route, 0.0, end, scene.room())
    if np.min(_apart(route, 2.0 * wide + 0.02)) < 2.0 * wide + 0.01:
        raise UselessDraw
    tubes = [(route, 0.0, end, wide)]
    for before, corner in pairwise(corners[:-1]):
        if rng.uniform() < 0.6:
            way = unit(corner - before)
            ends = corner - (bend + 0.02) * way, corner + float(rng.uniform(0.1, 0.2)) * way
            onwards = Route(np.stack(ends))
            tubes.append((onwards, 0.0, onwards.length, wide))
    scene.bodies["network"] = joined_pipes(tubes)


def _apart(route: Route, near: float) -> FloatArray:
    """Return distances between points of a path that are far from each other along the path, and infinity [m]."""
    places, arcs = route.places[::4], route.arcs[::4]
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    return np.append(apart[np.abs(arcs[:, None] - arcs) > 2.0 * near], np.inf)


def guided(scene: Drawing) -> None:
    """Out of a guide tube into a duct of changing section."""
    rng, lead, bend = scene.rng, scene.lead(), scene.bend()
    scene.length, scene.radius = 1.1, 0.012
    route = meander(rng, lead, float(rng.uniform(0.6, 0.95)), bend)
    swept = scene.go(route)
    long = scene.length + IN_TUBE
    inner = scene.radius + float(rng.uniform(0.0045, 0.006))
    scene.bodies["guide"] = thick_tube(-(long + 0.03) * X, ORIGIN, inner, 0.003)
    low, high = 0.02, route.length + 0.04
    shares = np.linspace(0.0, 1.0, len(route.part(low, high)))
    extra = np.interp(shares, np.linspace(0.0, 1.0, 7), rng.uniform(0.0, 0.025, 7))
    widths = swept.widths(route, low, high, scene.room())
    spread = max(3, int(0.02 / (high - low) * len(widths)))
    widest = np.max([np.roll(widths, k)[spread:-spread] for k in range(-spread, spread + 1)], axis=0)
    widest = np.pad(widest, spread, mode="edge")
    scene.bodies["duct"] = sheet(*bands(rings_along(route, low, high, widest + extra)))


def _bore(scene: Drawing, swept: Swept, route: Route, plane: float, half: float, name: str, *, thick: bool) -> None:
    """Add a block with a blind hole around the end of a path, with its front perpendicular to x.

    Args:
        scene: the scene.
        swept: volume swept by the arm in the hole.
        route: the path.
        plane: x coordinate of the front [m].
        half: half the side of the front [m].
        name: name of the block.
        thick: whether the block is solid, instead of a surface.
    """
    arcs = route.arcs
    mouth = float(arcs[np.argmax(route.places[:, 0] > plane)])
    if mouth <= 0.0:
        raise UselessDraw
    room = scene.room()
    wide = swept.width(route, mouth, route.length, room)
    place = route.at(np.array(mouth))
    middle, hole = swept.opening(place, X, room)
    rings = rings_along(route, mouth + 0.012, route.length + 0.015 + scene.radius + room, wide)
    across = outline_about(middle, X, max(hole, wide), square=False)
    # The mouth has its corners where those of the bore are.
    rings[0:0] = [across[np.argmin(np.linalg.norm(across[:, None] - rings[0], axis=2), axis=0)]]
    front = rings[0] - middle
    front = middle + half * front / np.max(np.abs(front), axis=1)[:, None]
    back = front + (max(0.0, float(np.max(rings[-1][:, 0])) - plane) + 0.05) * X
    if np.max(np.abs(np.concatenate(rings) - middle)[:, 1:]) > half - 0.005:
        raise UselessDraw
    if thick:
        vertices, faces = bands([back, front, *rings], capped=True)
        lid = np.column_stack((np.zeros(len(back) - 2), np.arange(2, len(back)), np.arange(1, len(back) - 1)))
        scene.bodies[name] = sheet(vertices, np.concatenate((faces, lid.astype(np.int64))), solid=True)
    else:
        scene.bodies[name] = sheet(*bands([front, *rings], capped=True))


def pocket(scene: Drawing) -> None:
    """Deep into a narrow pocket of a block."""
    rng, lead, bend = scene.rng, scene.lead(), scene.bend()
    scene.length = 1.0
    way = scene.tilted(X, 0.5)
    x = lead + 3.0 * bend + 0.05
    place = np.array([x, *rng.uniform(-0.15, 0.15, 2)])
    if rng.uniform() < 0.5:
        aside = meander(rng, scene.lead(), float(rng.uniform(0.4, 0.8)) * x, bend)
        scene.go(aside, begin=aside.length, end=scene.link)
        scene.start = "out"
    corners = np.stack((ORIGIN, (lead + bend) * X, place - 0.5 * bend * way, place + rng.uniform(0.1, 0.2) * way))
    route = Route.round_corners(corners, bend)
    _bore(scene, scene.go(route), route, x - 0.3 * bend, 0.3, "block", thick=True)
    scene.strew(lambda: scene.bar(0.05, 0.2, 0.008), "rod", 8)


def baffles(scene: Drawing) -> None:
    """Through the staggered holes of a tank's baffles."""
    rng, lead, bend = scene.rng, scene.lead(), scene.bend()
    scene.length, scene.radius = 1.4, 0.013
    lead, bend = scene.lead(), scene.bend()
    apart = max(0.2, 1.4 * bend)
    places = [np.array([lead + bend + 0.05, 0.0, 0.0]) + np.append(0.0, rng.uniform(-0.06, 0.06, 2))]
    while places[-1][0] + apart < 1.15 and len(places) < 5:
        places.append(np.array([places[-1][0] + apart * rng.uniform(1.0, 1.2), *rng.uniform(-0.09, 0.09, 2)]))
    goal = places[-1] + np.array([rng.uniform(0.08, 0.12), *rng.uniform(-0.05, 0.05, 2)])
    route = Route.round_corners(np.stack((ORIGIN, lead * X, *places, goal)), bend)
    swept = scene.go(route)
    outer = float(rng.uniform(0.2, 0.25))
    scene.bodies["shell"] = thick_tube(0.02 * X, (goal[0] + 0.1) * X, outer, 0.006)
    for k, place in enumerate(places):
        middle, hole = swept.opening(place, X, scene.room())
        outline = outline_about(place[0] * X, X, outer - 0.003, square=False)
        scene.bodies[f"baffle {k + 1}"] = thick_plate(middle, X, hole + 0.002, outline, 0.003)


def helix(scene: Drawing) -> None:
    """Along a helical pipe."""
    rng, lead = scene.rng, scene.lead()
    scene.length = 1.2
    wide = max(0.085, 1.25 * scene.link) * float(rng.uniform(1.0, 1.25))
    rise = float(rng.uniform(0.09, 0.14)) / (2.0 * np.pi)
    turns = float(rng.uniform(0.8, 1.7))
    angles = np.arange(0.0, 2.0 * np.pi * turns, STEP_OF_HELIX)
    places = np.column_stack((wide * np.sin(angles), wide * (1.0 - np.cos(angles)), rise * angles))
    # Turned so that it begins along x.
    along = unit(np.array([wide, 0.0, rise]))
    places = places @ np.column_stack((along, Y, np.cross(along, Y)))
    straight = np.arange(0.0, lead, 0.004)[:, None] * X
    route = Route(np.concatenate((straight, lead * X + places)))
    if route.length > 0.97 * scene.length:
        raise UselessDraw
    inner = scene.go(route).width(route, 0.0, route.length + 0.05, scene.room())
    if np.min(_apart(route, 2.0 * inner + 0.02)) < 2.0 * inner + 0.012:
        raise UselessDraw
    scene.bodies["pipe"] = thick_pipe(route, 0.0, route.length + 0.05, inner, 0.002)


def tours(scene: Drawing, count: int = 0) -> None:
    """Into several pockets of a bulkhead, one after the other."""
    rng = scene.rng
    scene.length = 1.1
    count = count or int(rng.integers(3, 6))
    tile = 0.12
    cells = [np.array([y, z]) for y in (-2, 0, 2) for z in (-2, 0, 2)]
    # Pockets that are not wanted are closed.
    chosen = rng.permutation(len(cells))
    bend = scene.bend()
    plane = scene.lead() + 3.0 * bend + 0.04
    for k in chosen[:count]:
        place = np.array([plane, *(tile * 0.75 * cells[k] / 1.5)])
        way = scene.tilted(X, 0.35)
        lead = scene.link + 0.02
        corners = np.stack(
            (ORIGIN, (lead + 0.6 * bend) * X, place - 0.5 * bend * way, place + rng.uniform(0.09, 0.16) * way)
        )
        route = Route.round_corners(corners, bend)
        swept = scene.go(route, begin=scene.link if scene.legs else None)
        _bore(scene, swept, route, plane, 0.5 * tile, f"pocket {k}", thick=False)
        scene.legs.append(followed(scene.arm, route, np.linspace(route.length, scene.link, 90)))
    scene.legs.pop()
    for k in chosen[count:]:
        low = np.array([plane, *(0.5 * tile * (cells[k] - 1.0))])
        scene.bodies[f"panel {k}"] = box(low, low + np.array([0.004, tile, tile]))


def reversed_task(scene: Drawing) -> None:
    """Out of a pocket in which the arm stands, into another one or to a place outside."""
    rng = scene.rng
    tours(scene, 2)
    if rng.uniform() < 0.4:
        # Out of the first pocket and to a place before the bulkhead.
        scene.legs, scene.stops = scene.legs[:2], [2]
        route = meander(rng, scene.lead(), min(0.9 * scene.length, 0.3 + scene.lead()), scene.bend())
        if np.max(route.places[:, 0]) > 0.5:
            raise UselessDraw
        scene.go(route, begin=scene.link)
        scene.stops = [len(scene.legs)]
    else:
        scene.stops = scene.stops[-1:]
    scene.legs = scene.legs[1:]
    scene.stops = [stop - 1 for stop in scene.stops]
