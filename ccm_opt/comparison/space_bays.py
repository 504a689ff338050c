"""Bays and rows for snake arms: between the frames of a fuselage, rows of blades, boxes with ribs."""

import numpy as np

from ccm_opt.comparison.space_routes import Route
from ccm_opt.comparison.space_shells import holed_plate, ring, straight_pipe
from ccm_opt.comparison.space_site import Site
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.space.scene.bodies import Body, BoxBody, CapsuleBody
from ccm_opt.space.scene.rigid_placement import RigidPlacement

X = np.array([1.0, 0.0, 0.0])


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
            BoxBody(np.array([skin + 2.0 * half, -0.45, -0.45]), np.array([skin + 2.0 * half + thick, 0.45, 0.45])),
        ),
        ("front spar", BoxBody(np.array([skin, -half - thick, low]), np.array([skin + 2.0 * half, -half, high]))),
        ("rear spar", BoxBody(np.array([skin, half, low]), np.array([skin + 2.0 * half, half + thick, high]))),
        ("root rib", BoxBody(np.array([skin, -half, low - thick]), np.array([skin + 2.0 * half, half, low]))),
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
