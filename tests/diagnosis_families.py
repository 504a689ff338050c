"""Unsolvable planar problems in six families, with the reason and the threshold of feasibility known by construction.

Arm and obstacles of each family are random. Thresholds are computed in closed form without code of the package: lengths
of shortest paths around a circle, widths of gaps, chords of circular arcs, lever arms.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ccm_opt.core.arrays import FloatArray

TOLERANCE = 1e-3
"""Tolerance of the goal position [m], the default of problem files."""
GRAVITY = 9.81
FAMILIES = ("too short", "too thick", "too stiff", "blocked", "contact", "torque")


@dataclass(frozen=True)
class Case:
    """One unsolvable problem, with the parameter that makes it solvable if changed.

    Attributes:
        family: kind of the finding that the diagnosis should name first.
        data: tables of the problem file.
        key: key of the parameter in the problem file.
        threshold: value of the parameter at which the problem becomes solvable, in SI units and radians; or the name of
            the obstacle to remove.
        named: words that the reason of the diagnosis must contain, such as names of obstacles and links.
        sign: +1 if the parameter must be larger than the threshold, −1 if smaller, 0 for an obstacle.
    """

    family: str
    data: dict[str, Any]
    key: str
    threshold: float | str
    named: tuple[str, ...] = ()
    sign: int = 0


def make_case(family: str, seed: int) -> Case:
    """Return the random problem of a family for a seed."""
    rng = np.random.default_rng([FAMILIES.index(family), seed])
    case = MAKERS[family](rng)
    name = f"{family.replace(' ', '-')}-{seed}"
    return Case(case.family, {"schema": 1, "name": name, **case.data}, case.key, case.threshold, case.named, case.sign)


def _tables(rng: np.random.Generator, length: float, radius: float, **arm: Any) -> dict[str, Any]:
    """Return tables of a problem in a large empty workspace, with an arm at the origin, straight along x.

    Args:
        rng: random generator.
        length: length of the arm [m].
        radius: radius of the arm [m].
        **arm: further keys of the table of the arm.
    """
    links = int(rng.choice([12, 16, 20, 24]))
    return {
        "workspace": {"bounds": [-3.0, -3.0, 3.0, 3.0], "obstacles": []},
        "arm": {
            "links": links,
            "link_length": length / links,
            "radius": radius,
            "base": [0.0, 0.0],
            "joint_limit_deg": 60.0,
            **arm,
        },
        "limits": {"velocity": 1.0, "acceleration": 2.0},
        "start": {"shape": "straight"},
        "goal": {"position": [0.0, 0.0]},
        "planner": {"time_limit": 60.0},
    }


def _pointing(links: int, degrees: float) -> dict[str, Any]:
    """Return the table of a straight start that points in a direction."""
    return {"joints_deg": [degrees, *[0.0] * (links - 1)]}


def _at(distance: float, angle: float) -> list[float]:
    return [float(distance * np.cos(angle)), float(distance * np.sin(angle))]


def too_short(rng: np.random.Generator) -> Case:
    """Return a case whose goal is too far away, in free space or around the end of a wall."""
    share = rng.uniform(0.7, 0.96)
    radius = rng.uniform(0.015, 0.03)
    if rng.random() < 0.5:
        distance = rng.uniform(0.8, 1.6)
        data = _tables(rng, share * distance, radius)
        data["goal"]["position"] = _at(distance, rng.uniform(-3.0, 3.0))
        need = distance
        named = ("out of reach",)
    else:
        ahead = rng.uniform(0.3, 0.5)
        height = rng.uniform(0.15, 0.5)
        thickness = rng.uniform(0.02, 0.08)
        goal = np.array([ahead + rng.uniform(0.15, 0.5), rng.uniform(-0.2, 0.1)])
        end = np.array([ahead, height])
        need = string_round(np.zeros(2), goal, end, radius + 0.5 * thickness)
        data = _tables(rng, share * need, radius)
        screen = {"points": [[ahead, -3.0], end.tolist()], "thickness": thickness}
        data["workspace"]["obstacles"] = [{"name": "screen", "wall": screen}]
        data["goal"]["position"] = goal.tolist()
        named = ("'screen'",)
        data["start"] = _pointing(data["arm"]["links"], rng.uniform(95.0, 150.0))
    links = data["arm"]["links"]
    return Case("too short", data, "arm.link_length", (need - TOLERANCE) / links, named, 1)


def string_round(start: FloatArray, goal: FloatArray, middle: FloatArray, radius: float) -> float:
    """Return the length of the shortest path between two points around a circle, two tangents and an arc [m].

    Args:
        start: first point, shape (2,) [m].
        goal: second point, shape (2,) [m].
        middle: centre of the circle, above the line from start to goal, shape (2,) [m].
        radius: radius of the circle [m].
    """
    one = start - middle
    other = goal - middle
    tangents = [float(np.sqrt(v @ v - radius**2)) for v in (one, other)]
    cosine = float(one @ other / np.sqrt((one @ one) * (other @ other)))
    seen = sum(float(np.arccos(radius / np.hypot(*v))) for v in (one, other))
    angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return sum(tangents) + radius * (2.0 * np.pi - angle - seen)


def too_thick(rng: np.random.Generator) -> Case:
    """Return a case with a wall across the workspace whose single gap is narrower than the arm and its clearance."""
    radius = rng.uniform(0.03, 0.05)
    clearance = float(rng.choice([0.0, 0.0, 0.004]))
    thick = radius / rng.uniform(0.6, 0.93)
    width = 2.0 * (radius + clearance)
    ahead = rng.uniform(0.35, 0.5)
    middle = rng.uniform(-0.15, 0.15)
    depth = rng.uniform(0.02, 0.15)
    data = _tables(rng, rng.uniform(1.1, 1.4), thick)
    low = middle - 0.5 * width
    high = middle + 0.5 * width
    data["workspace"]["clearance"] = clearance
    data["workspace"]["obstacles"] = [
        {"name": "upper wall", "box": [ahead, high, ahead + depth, 3.0]},
        {"name": "lower wall", "box": [ahead, -3.0, ahead + depth, low]},
        {"name": "bystander", "circle": {"center": [-1.2, 1.2], "radius": 0.2}},
    ]
    data["goal"]["position"] = [ahead + depth + rng.uniform(0.15, 0.35), middle + rng.uniform(-0.1, 0.1)]
    data["start"] = _pointing(data["arm"]["links"], float(rng.choice([-1.0, 1.0])) * rng.uniform(100.0, 170.0))
    return Case("too thick", data, "arm.radius", radius, ("'upper wall'", "'lower wall'"), -1)


def too_stiff(rng: np.random.Generator) -> Case:
    """Return a case whose goal requires larger joint angles than allowed, at the end of a circular arc."""
    data = _tables(rng, rng.uniform(0.9, 1.3), rng.uniform(0.01, 0.02))
    arm = data["arm"]
    links = arm["links"]
    link = arm["link_length"]
    share = rng.uniform(0.6, 0.95)
    if rng.random() < 0.5:
        turn = np.deg2rad(rng.uniform(60.0, 165.0))
        base = np.deg2rad(rng.uniform(5.0, 10.0))
        bend = (turn - base) / (links - 1)
        side = float(rng.choice([-1.0, 1.0]))
        headings = side * (base + bend * np.arange(links))
        arm["base_limit_deg"] = float(np.rad2deg(base))
        steps = link * np.column_stack((np.cos(headings), np.sin(headings)))
        data["goal"] = {"position": steps.sum(axis=0).tolist(), "heading_deg": float(np.rad2deg(headings[-1]))}
        arm["joint_limit_deg"] = float(np.rad2deg(share * bend))
    else:
        distance = rng.uniform(0.15, 0.5) * links * link
        bend = brentq(lambda b: link * np.sin(0.5 * links * b) / np.sin(0.5 * b) - distance, 1e-6, 2.0 * np.pi / links)
        data["goal"]["position"] = _at(distance, rng.uniform(-3.0, 3.0))
        arm["joint_limit_deg"] = float(np.rad2deg(share * bend))
    return Case("too stiff", data, "arm.joint_limit_deg", float(bend), ("cannot",), 1)


def blocked(rng: np.random.Generator) -> Case:
    """Return a case with two rooms joined by a door that an obstacle closes, among other obstacles."""
    door = rng.uniform(0.18, 0.3)
    ahead = rng.uniform(0.35, 0.5)
    thickness = rng.uniform(0.05, 0.15)
    middle = rng.uniform(-0.1, 0.1)
    low = middle - 0.5 * door
    high = middle + 0.5 * door
    far = ahead + thickness
    outline = [
        [-2.0, -2.0], [ahead, -2.0], [ahead, low], [far, low], [far, -2.0], [3.0, -2.0],
        [3.0, 2.0], [far, 2.0], [far, high], [ahead, high], [ahead, 2.0], [-2.0, 2.0],
    ]  # fmt: skip
    data = _tables(rng, rng.uniform(1.1, 1.4), rng.uniform(0.015, 0.03))
    lap = rng.uniform(0.005, 0.05)
    shutter = [[ahead + 0.3 * thickness, low - lap], [ahead + 0.6 * thickness, high + lap]]
    others = [
        {"name": f"post {k}", "circle": {"center": [-1.0 + 0.4 * k, 1.4], "radius": rng.uniform(0.03, 0.1)}}
        for k in range(3)
    ]
    obstacle = {"name": "shutter", "box": [*shutter[0], *shutter[1]]}
    data["workspace"] = {"boundary": outline, "obstacles": [*others, obstacle]}
    data["goal"]["position"] = [far + rng.uniform(0.1, 0.3), middle + rng.uniform(-0.1, 0.1)]
    data["start"] = _pointing(data["arm"]["links"], float(rng.choice([-1.0, 1.0])) * rng.uniform(100.0, 170.0))
    return Case("blocked", data, "workspace.obstacles", "shutter", ("'shutter'",))


def contact(rng: np.random.Generator) -> Case:
    """Return a case with an obstacle in contact with the start, a goal pose of the whole arm, or the tip goal."""
    thick = rng.uniform(0.03, 0.05)
    data = _tables(rng, rng.uniform(1.0, 1.3), thick)
    links = data["arm"]["links"]
    link = data["arm"]["link_length"]
    which = str(rng.choice(["start", "goal", "tip"]))
    gap = rng.uniform(0.6, 0.93) * thick
    bends = np.full(links, rng.choice([-1.0, 1.0]) * np.deg2rad(rng.uniform(60.0, 120.0)) / links)
    post = rng.uniform(0.02, 0.06)
    number = int(rng.integers(links // 3, links - 2))
    side = float(rng.choice([-1.0, 1.0]))
    if which == "start":
        middle = np.array([(number + 0.5) * link, side * (gap + post)])
        turn = -side * rng.uniform(50.0, 110.0)
        data["goal"] = {"position": _at(rng.uniform(0.6, 0.8) * links * link, np.deg2rad(turn))}
        threshold = gap
        named = ("'post'", f"link {number + 1}")
    else:
        headings = np.cumsum(bends)
        steps = link * np.column_stack((np.cos(headings), np.sin(headings)))
        points = np.vstack((np.zeros(2), np.cumsum(steps, axis=0)))
        outside = -float(np.sign(bends[0]))
        if which == "goal":
            normal = outside * np.array([-np.sin(headings[number]), np.cos(headings[number])])
            middle = 0.5 * (points[number] + points[number + 1]) + (gap + post) * normal
            data["goal"] = {"joints_deg": np.rad2deg(bends).tolist()}
            threshold = gap
            named = ("'post'", f"link {number + 1}")
        else:
            ahead = np.array([np.cos(headings[-1]), np.sin(headings[-1])])
            middle = points[-1] + (gap + post) * ahead
            data["goal"] = {"position": points[-1].tolist()}
            threshold = gap + TOLERANCE
            named = ("'post'", "the tip")
        data["start"] = _pointing(links, float(-np.sign(bends[0])) * rng.uniform(60.0, 120.0))
    data["workspace"]["obstacles"] = [{"name": "post", "circle": {"center": middle.tolist(), "radius": post}}]
    return Case("contact", data, "arm.radius", float(threshold), named, -1)


def torque(rng: np.random.Generator) -> Case:
    """Return a case with a torque limit too low to hold the start or a goal pose of the whole arm."""
    data = _tables(rng, rng.uniform(0.6, 1.2), rng.uniform(0.01, 0.03))
    links = data["arm"]["links"]
    link = data["arm"]["link_length"]
    mass = rng.uniform(0.03, 0.2)
    data["arm"]["link_mass"] = mass
    tilt = rng.uniform(-30.0, 30.0)
    lever = 0.5 * links * link * np.cos(np.deg2rad(tilt))
    need = links * mass * GRAVITY * lever
    data["limits"]["torque"] = float(rng.uniform(0.5, 0.93) * need)
    steep = float(np.sign(tilt)) * rng.uniform(60.0, 110.0)
    weak = _pointing(links, tilt)
    easy = _pointing(links, steep)
    if rng.random() < 0.5:
        data["start"] = weak
        data["goal"] = {"position": _at(rng.uniform(0.9, 0.97) * links * link, np.deg2rad(steep))}
    else:
        data["start"] = easy
        data["goal"] = weak
    return Case("torque", data, "limits.torque", float(need), ("joint 1 ",), 1)


MAKERS: dict[str, Callable[[np.random.Generator], Case]] = {
    "too short": too_short,
    "too thick": too_thick,
    "too stiff": too_stiff,
    "blocked": blocked,
    "contact": contact,
    "torque": torque,
}
