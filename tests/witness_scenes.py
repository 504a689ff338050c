"""Scenes in space drawn around a motion that is known to be possible, its witness.

    python -m tests.witness_scenes OUT --family ribs --links 24 --seed 0 --start inside

The witness comes first (``witness_motions.py``); holes, pipes and bodies are then placed about all that it sweeps so
that it has 4 to 11 mm of room as a rule. A sweep with coal, which shares nothing with the package's proofs, measures
the least gap that it really has. Scenes of odd seeds are turned at random. Where the base is fixed, a start has no tube
to be in.
"""

import argparse
import json
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from ccm_opt.cli.compare.comparison_files import write_problems
from ccm_opt.cli.compare.space_clutter import arm_of_links
from ccm_opt.cli.compare.suites import Case
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import JointPose, Problem, Stop, TipGoal, Tolerances
from ccm_opt.robot.arm import Arm, Feed
from ccm_opt.robot.coordinates import Limits
from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, RigidPlacement, SphereBody
from ccm_opt.scene.workspace import Obstacle, Workspace

from .benchmarks.space_sweep import sweep_rows
from .space_ducts import (
    ORIGIN,
    Bodies,
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
from .witness_motions import MOST_BEND, Swept, followed, meander, smooth_bends

IN_TUBE = 0.05
"""How far the tip is inside the guide tube at a start inside [m]."""
LEAST_GAP = 0.003
"""A witness with less room is of no use [m]."""
MOST_DRAWS = 60
"""After so many draws of no use, none is made of a seed."""
VELOCITY, ACCELERATION = 1.0, 4.0
"""Of every revolute [rad/s, rad/s²]."""
FEED_VELOCITY, FEED_ACCELERATION = 0.15, 0.6
"""Of the feed axis [m/s, m/s²]."""
Y, Z = np.eye(3)[1:]


@dataclass(frozen=True, eq=False)
class Witness:
    """A problem and a motion that solves it.

    Attributes:
        problem: the problem.
        rows: configurations, between which the motion is linear, shape (T, c) [rad, m].
        stops: rows at which it is at a goal, in order.
        gap: its least gap to bodies by coal [m].
        bound: time that it takes at least within the limits [s].
    """

    problem: Problem
    rows: FloatArray
    stops: tuple[int, ...]
    gap: float
    bound: float


@dataclass(eq=False)
class Drawing:
    """A scene while it is drawn: guide tube or base at the origin, along x.

    Attributes:
        rng: source of all draws.
        links: number of links.
        start: "inside" the guide tube or fed "out".
        length: of the arm [m].
        radius: of the arm [m].
        legs: rows of configurations of motions one after the other, the last row of one the first of the next.
        stops: numbers of the legs at whose ends there is a goal.
        bodies: by their names.
        fed: whether the arm has a feed axis.
    """

    rng: np.random.Generator
    links: int
    start: str
    length: float = 1.2
    radius: float = 0.01
    legs: list[FloatArray] = field(default_factory=list)
    stops: list[int] = field(default_factory=list)
    bodies: Bodies = field(default_factory=dict)
    fed: bool = True

    @property
    def arm(self) -> Arm:
        """The arm with joints that bend as far as any witness."""
        arm = replace(arm_of_links(self.links, self.length, self.radius), joint_limit=0.5 * np.pi)
        if not self.fed:
            return arm
        base = np.array([-self.length - IN_TUBE, 0.0, 0.0])
        return replace(arm, base=base, feed=Feed(0.0, self.length + IN_TUBE, self.length + IN_TUBE))

    @property
    def link(self) -> float:
        """Length of a link [m]."""
        return self.length / self.links

    @property
    def lead(self) -> float:
        """Length of the straight beginning of routes: nothing bends before a link is out of the tube [m]."""
        return self.link + float(self.rng.uniform(0.01, 0.04))

    @property
    def bend(self) -> float:
        """Radius of bends that the arm follows [m]."""
        return max(0.08, 1.3 * self.link) * float(self.rng.uniform(1.0, 1.3))

    def room(self) -> float:
        """Room about the witness [m]."""
        return float(self.rng.uniform(0.0042, 0.011))

    def go(self, route: Route, end: float | None = None, begin: float | None = None) -> Swept:
        """Follow a route from a tip's arc length, or from the start, to another and let there be a goal."""
        shown = self.link if self.start == "out" else -IN_TUBE
        begin = shown if begin is None else begin
        end = route.length if end is None else end
        if end > self.length:
            raise UselessDraw
        count = max(10, int(abs(end - begin) / min(0.012, 0.3 * self.link)))
        self.legs.append(followed(self.arm, route, np.linspace(begin, end, count)))
        if end > begin:
            self.stops.append(len(self.legs))
        return Swept(self.arm, self.legs[-1])

    def strew(self, draw: Callable[[], Body], name: str, count: int) -> None:
        """Place so many bodies about everything that is swept."""
        swept = Swept(self.arm, np.concatenate(self.legs))
        for k, body in enumerate(swept.strew(self.rng, draw, count, self.room)):
            self.bodies[f"{name} {k}"] = body

    def bar(self, low: float, high: float, radius: float) -> CapsuleBody:
        """Draw a bar of a length between two about the origin [m]."""
        half = 0.5 * float(self.rng.uniform(low, high)) * unit(self.rng.normal(size=3))
        return CapsuleBody(-half, half, radius)

    def block(self, low: float, high: float) -> BoxBody:
        """Draw a box with sides between two lengths about the origin [m]."""
        half = 0.5 * self.rng.uniform(low, high, 3)
        return BoxBody(-half, half, RigidPlacement.of_quaternion(ORIGIN, self.rng.normal(size=4)))

    def jagged(self, size: float) -> Body:
        """Draw a closed mesh of a size about the origin [m]."""
        rings = [r * outline_about(z * Z, Z, 1.0, square=False) + (1.0 - r) * z * Z for r, z in self._profile(size)]
        return sheet(*bands(rings, closed=True), solid=True)

    def _profile(self, size: float) -> list[tuple[float, float]]:
        """Radii and heights of a ring with a section of three corners [m]."""
        wide = size * float(self.rng.uniform(0.3, 0.5))
        return [(0.5 * wide, 0.0), (wide, 0.3 * size), (wide, -0.3 * size)]

    def plate(self, name: str, place: FloatArray, normal: FloatArray, swept: Swept, half: float) -> None:
        """Put a plate with a hole where the witness passes."""
        middle, hole = swept.opening(place, normal, self.room())
        thick = float(self.rng.uniform(0.001, 0.003))
        outline = outline_about(place, normal, half)
        self.bodies[name] = thick_plate(middle, normal, hole + 0.5 * thick, outline, thick)

    def tilted(self, way: FloatArray, most: float) -> FloatArray:
        """Draw a direction within an angle of another [rad]."""
        side = self.rng.normal(size=3)
        side = unit(side - (side @ way) * way)
        angle = float(self.rng.uniform(0.3, 1.0)) * most
        return np.asarray(np.cos(angle) * way + np.sin(angle) * side)

    def poses(self, bend: float, flat: float = 1.0, common: float = 0.0) -> Swept:
        """Move straight from one smooth pose to another, which share the first part of the arm, and let be a goal."""
        self.fed = False
        arm = self.arm
        one, other = (smooth_bends(self.rng, arm, bend * float(self.rng.uniform(0.5, 1.0)), flat) for _ in range(2))
        shared = 2 * int(common * self.links)
        other[:shared] = one[:shared]
        if max(np.max(np.abs(one)), np.max(np.abs(other))) > MOST_BEND:
            raise UselessDraw
        self.legs.append(one + np.linspace(0.0, 1.0, 60)[:, None] * (other - one))
        self.stops.append(1)
        return Swept(arm, self.legs[0])


def ribs(scene: Drawing) -> None:
    """Through an access hole of a wing box, then along it through the holes of its ribs."""
    rng, lead, bend = scene.rng, scene.lead, scene.bend
    scene.length, scene.radius = float(rng.uniform(1.2, 1.5)), float(rng.uniform(0.011, 0.014))
    lead, bend = scene.lead, scene.bend
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
    rng, lead, bend = scene.rng, scene.lead, scene.bend
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
    """Distances between places of a route that are far from each other along it [m]."""
    places, arcs = route.places[::4], route.arcs[::4]
    apart = np.linalg.norm(places[:, None] - places, axis=2)
    return np.append(apart[np.abs(arcs[:, None] - arcs) > 2.0 * near], np.inf)


def cables(scene: Drawing) -> None:
    """Through a forest of thin cables."""
    scene.length = float(scene.rng.uniform(0.8, 1.0))
    scene.go(meander(scene.rng, scene.lead, 0.95 * scene.length, scene.bend))
    scene.strew(lambda: scene.bar(0.5, 1.0, 0.002), "cable", int(scene.rng.integers(90, 150)))


def engine(scene: Drawing) -> None:
    """Among the boxes, cylinders and pipes of an engine bay."""
    rng = scene.rng
    scene.length = float(rng.uniform(0.9, 1.2))
    if rng.uniform() < 0.5:
        scene.go(meander(rng, scene.lead, 0.9 * scene.length, 1.2 * scene.bend))
    else:
        scene.poses(4.0)
    scene.strew(lambda: scene.block(0.08, 0.25), "unit", 12)
    scene.strew(lambda: _cylinder(scene), "canister", 8)
    scene.strew(lambda: scene.bar(0.3, 0.8, float(rng.uniform(0.008, 0.02))), "line", 25)


def _cylinder(scene: Drawing) -> CylinderBody:
    half = 0.5 * float(scene.rng.uniform(0.1, 0.3)) * unit(scene.rng.normal(size=3))
    return CylinderBody(-half, half, float(scene.rng.uniform(0.03, 0.08)))


def weave(scene: Drawing) -> None:
    """Out of a tangle of bars into another one; the base is fixed."""
    scene.length, scene.radius = 1.0, 0.012
    scene.poses(5.0)
    scene.strew(lambda: scene.bar(0.2, 0.8, 0.006), "bar", int(scene.rng.integers(70, 120)))
    half = 0.5 * np.array([0.006, 0.12, 0.12])
    scene.strew(
        lambda: BoxBody(-half, half, RigidPlacement.of_quaternion(ORIGIN, scene.rng.normal(size=4))), "slat", 35
    )


def shapes(scene: Drawing) -> None:
    """Among boxes, balls, cylinders and meshes; the base is fixed."""
    rng = scene.rng
    scene.length, scene.radius = 1.0, 0.014
    scene.poses(4.0)
    scene.strew(lambda: scene.block(0.05, 0.2), "box", 15)
    scene.strew(lambda: SphereBody(ORIGIN, float(rng.uniform(0.03, 0.1))), "ball", 12)
    scene.strew(lambda: _cylinder(scene), "can", 6)
    scene.strew(lambda: scene.jagged(float(rng.uniform(0.1, 0.25))), "ring", 8)


def rack(scene: Drawing) -> None:
    """Between two shelves of a rack and among what stands there."""
    rng = scene.rng
    scene.length = float(rng.uniform(0.9, 1.1))
    if rng.uniform() < 0.5:
        route = meander(rng, scene.lead, 0.9 * scene.length, scene.bend)
        route = Route(route.places * [1.0, 1.0, 0.25])
        swept = scene.go(route)
    else:
        swept = scene.poses(3.5, flat=0.15)
    low, high = (float(each(swept.points[:, 2])) for each in (np.min, np.max))
    margin = scene.radius + scene.room()
    scene.bodies |= {
        "shelf below": box([0.1, -0.8, low - margin - 0.01], [1.2, 0.8, low - margin]),
        "shelf above": box([0.1, -0.8, high + margin], [1.2, 0.8, high + margin + 0.01]),
    }
    tall = 0.5 * (high - low) + margin

    def standing() -> Body:
        half = np.array([*rng.uniform(0.02, 0.08, 2), tall])
        if rng.uniform() < 0.5:
            return CylinderBody(-half[2] * Z, half[2] * Z, half[0])
        return BoxBody(-half, half)

    tries = [swept.beside(rng, standing(), scene.room()) for _ in range(60)]
    goods = [each.moved(np.array([0.0, 0.0, 0.5 * (low + high) - each.middle[2]])) for each in tries if each]
    kept = [each for each in goods if swept.gap(each) > 0.0045][:14]
    scene.bodies |= {f"unit {k}": each for k, each in enumerate(kept)}


def keyhole(scene: Drawing) -> None:
    """Through a hole of a plate, and beyond it among bars."""
    rng = scene.rng
    scene.length, scene.radius = 1.0, 0.012
    if rng.uniform() < 0.5:
        route = meander(rng, scene.lead, 0.9 * scene.length, 1.1 * scene.bend)
        swept = scene.go(route)
        place, way = route.at(np.array([0.3, 0.301]))
        way = unit(way - place)
    else:
        swept = scene.poses(4.0, common=0.3)
        chain = swept.chains[0]
        k = max(1, int(0.2 * scene.links))
        place, way = 0.5 * (chain[k] + chain[k + 1]), unit(chain[k + 1] - chain[k])
    scene.plate("plate", place, way, swept, 0.4)
    scene.strew(lambda: scene.bar(0.2, 0.6, 0.008), "bar", 25)


def truss(scene: Drawing) -> None:
    """Among the struts of a space frame."""
    rng = scene.rng
    scene.length = float(rng.uniform(0.9, 1.2))
    if rng.uniform() < 0.5:
        swept = scene.go(meander(rng, scene.lead, 0.9 * scene.length, scene.bend))
    else:
        swept = scene.poses(4.0)
    apart = float(rng.uniform(0.16, 0.22))
    low, high = swept.points.min(axis=0) - 0.5 * apart, swept.points.max(axis=0) + apart
    low[0] = max(low[0], -0.3)
    steps = [np.arange(a, b, apart) for a, b in zip(low, high, strict=True)]
    nodes = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    nodes += rng.uniform(-0.02, 0.02, nodes.shape)
    pairs = np.argwhere(np.triu(np.linalg.norm(nodes[:, None] - nodes, axis=2) < 1.55 * apart, 1))
    rng.shuffle(pairs)
    bars = [CapsuleBody(nodes[i], nodes[j], 0.007) for i, j in pairs]
    near = [each for each in bars if scene.room() < swept.gap(each) < 0.2][:250]
    scene.bodies |= {f"strut {k}": each for k, each in enumerate(near)}


def guided(scene: Drawing) -> None:
    """Out of a guide tube into a duct of changing section."""
    rng, lead, bend = scene.rng, scene.lead, scene.bend
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
    """Put a block with a blind bore about the end of a route, its front across x at some place [m]."""
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
    rng, lead, bend = scene.rng, scene.lead, scene.bend
    scene.length = 1.0
    way = scene.tilted(X, 0.5)
    x = lead + 3.0 * bend + 0.05
    place = np.array([x, *rng.uniform(-0.15, 0.15, 2)])
    if rng.uniform() < 0.5:
        aside = meander(rng, scene.lead, float(rng.uniform(0.4, 0.8)) * x, bend)
        scene.go(aside, begin=aside.length, end=scene.link)
        scene.start = "out"
    corners = np.stack((ORIGIN, (lead + bend) * X, place - 0.5 * bend * way, place + rng.uniform(0.1, 0.2) * way))
    route = Route.round_corners(corners, bend)
    _bore(scene, scene.go(route), route, x - 0.3 * bend, 0.3, "block", thick=True)
    scene.strew(lambda: scene.bar(0.05, 0.2, 0.008), "rod", 8)


def baffles(scene: Drawing) -> None:
    """Through the staggered holes of a tank's baffles."""
    rng, lead, bend = scene.rng, scene.lead, scene.bend
    scene.length, scene.radius = 1.4, 0.013
    lead, bend = scene.lead, scene.bend
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
    rng, lead = scene.rng, scene.lead
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


STEP_OF_HELIX = 0.04
"""Between the places of its route [rad]."""


def tours(scene: Drawing, count: int = 0) -> None:
    """Into several pockets of a bulkhead, one after the other."""
    rng = scene.rng
    scene.length = 1.1
    count = count or int(rng.integers(3, 6))
    tile = 0.12
    cells = [np.array([y, z]) for y in (-2, 0, 2) for z in (-2, 0, 2)]
    # Pockets that are not wanted are closed.
    chosen = rng.permutation(len(cells))
    bend = scene.bend
    plane = scene.lead + 3.0 * bend + 0.04
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
        route = meander(rng, scene.lead, min(0.9 * scene.length, 0.3 + scene.lead), scene.bend)
        if np.max(route.places[:, 0]) > 0.5:
            raise UselessDraw
        scene.go(route, begin=scene.link)
        scene.stops = [len(scene.legs)]
    else:
        scene.stops = scene.stops[-1:]
    scene.legs = scene.legs[1:]
    scene.stops = [stop - 1 for stop in scene.stops]


FAMILIES: Mapping[str, Callable[[Drawing], None]] = {
    "ribs": ribs,
    "pipes": pipes,
    "cables": cables,
    "engine": engine,
    "weave": weave,
    "shapes": shapes,
    "rack": rack,
    "keyhole": keyhole,
    "truss": truss,
    "guided": guided,
    "pocket": pocket,
    "baffles": baffles,
    "helix": helix,
    "tours": tours,
    "reversed": reversed_task,
}
"""What draws a scene."""


def witness_scene(family: str, seed: int, links: int, start: str = "") -> Witness:
    """Draw a scene of a family.

    Args:
        family: its name.
        seed: of the draws.
        links: of the arm.
        start: "inside" the guide tube or fed "out"; drawn if empty.

    Raises:
        ProblemError: no draw was of use.
    """
    rng = np.random.default_rng([seed, links, zlib.crc32(family.encode())])
    begin = start or ("inside" if rng.uniform() < 0.6 else "out")
    for _ in range(MOST_DRAWS):
        scene = Drawing(rng, links, begin)
        try:
            FAMILIES[family](scene)
            return _witness(scene, f"{family}-{links}-{seed}", FAMILIES[family].__doc__ or "", turned=bool(seed % 2))
        except UselessDraw:
            continue
    raise ProblemError(
        f"{MOST_DRAWS} draws of the family {family} with {links} links and the seed {seed} are of no use"
    )


def _witness(scene: Drawing, name: str, description: str, *, turned: bool) -> Witness:
    """Return the problem of a scene and its witness, both turned with it."""
    rng, arm = scene.rng, scene.arm
    ends = np.cumsum([len(leg) for leg in scene.legs])
    rows = np.concatenate(scene.legs)
    stops = tuple(int(ends[leg - 1]) - 1 for leg in scene.stops)
    bodies = scene.bodies
    # What is found in use: joints that are bent to some three quarters of what they can do.
    bent = float(np.max(np.abs(rows[:, 2 : 2 * scene.links])))
    arm = replace(arm, joint_limit=min(max(bent / float(rng.uniform(0.7, 0.9)), np.deg2rad(8.0)), 0.5 * np.pi))
    if turned:
        by = RigidPlacement.of_quaternion(rng.uniform(-1.0, 1.0, 3), rng.normal(size=4))
        bodies = {name: body.placed(by) for name, body in bodies.items()}
        direction, up = by.rotation @ arm.direction, by.rotation @ arm.up
        arm = replace(arm, base=by.points(arm.base[None])[0], direction=direction, up=up)
    goals = [_goal(arm, rows[stop], directed=rng.uniform() < 0.85) for stop in stops]
    rates = np.ones(3 * scene.links)
    limits = Limits(VELOCITY * rates, ACCELERATION * rates)
    if scene.fed:
        limits = replace(limits, feed_velocity=FEED_VELOCITY, feed_acceleration=FEED_ACCELERATION)
    problem = Problem(
        name,
        Workspace(bounds=None, obstacles=tuple(Obstacle(*item) for item in bodies.items())),
        arm,
        limits,
        JointPose.from_configuration(rows[0], arm.coordinates),
        goals[-1],
        description,
        stops=tuple(Stop(goal, Tolerances()) for goal in goals[:-1]),
    )
    seen = sweep_rows(problem, rows)
    if seen.violations or min(seen.wall_gap, 0.5 * seen.self_gap) < LEAST_GAP:
        raise UselessDraw
    return Witness(problem, rows, stops, seen.wall_gap, _bound(rows, ends, fed=scene.fed))


def _goal(arm: Arm, q: FloatArray, *, directed: bool) -> TipGoal:
    return TipGoal(arm.joint_positions_at(q)[-1], arm.link_rotations(q)[-1, :, 0] if directed else None)


def _bound(rows: FloatArray, ends: FloatArray, *, fed: bool) -> float:
    """Return the time that legs from rest to rest take at least [s]."""
    begins = np.concatenate(([0], ends[:-1]))
    travel = np.abs(rows[ends - 1] - rows[begins])
    fastest = np.full(travel.shape[1], VELOCITY)
    quickest = np.full(travel.shape[1], ACCELERATION)
    if fed:
        fastest[-1], quickest[-1] = FEED_VELOCITY, FEED_ACCELERATION
    cruising = travel > fastest**2 / quickest
    times = np.where(cruising, travel / fastest + fastest / quickest, 2.0 * np.sqrt(travel / quickest))
    return float(np.sum(np.max(times, axis=1)))


def write_scene(witness: Witness, folder: Path) -> Path:
    """Write a problem file with its meshes, and beside it what is known of its witness; return the problem file."""
    problem = witness.problem
    (file,) = write_problems([Case(problem.name, "files", given=problem)], folder)
    known = {"gap_mm": 1e3 * witness.gap, "bound_s": witness.bound, "stops": witness.stops}
    record = known | {"wanted_mm": 1e3 * problem.wanted_gap, "rows": witness.rows.tolist()}
    file.with_suffix(".json").write_text(json.dumps(record), encoding="utf-8")
    return file


def main() -> None:
    """Write scenes."""
    parser = argparse.ArgumentParser(prog="python -m tests.witness_scenes", description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--family", choices=FAMILIES, nargs="+", default=list(FAMILIES))
    parser.add_argument("--links", type=int, nargs="+", default=[24])
    parser.add_argument("--seed", type=int, nargs="+", default=[0])
    parser.add_argument("--start", choices=["inside", "out"], default="")
    asked = parser.parse_args()
    for family in asked.family:
        for links in asked.links:
            for seed in asked.seed:
                try:
                    write_scene(witness_scene(family, seed, links, asked.start), asked.out)
                except ProblemError as error:
                    parser.exit(1, f"{error}\n")


if __name__ == "__main__":
    main()
