"""Unsolvable problems in space in six families, with the reason and the threshold of feasibility known by construction.

As for planar problems (``diagnosis_families``), thresholds are computed in closed form without code of the package:
lengths of shortest paths over an edge, widths of windows, chords of circular arcs, lever arms.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ccm_opt.core.arrays import FloatArray

from .diagnosis_families import GRAVITY, TOLERANCE, Case, string_round

SPACE_FAMILIES = ("too short", "too thick", "too stiff", "blocked", "contact", "torque")


def make_space_case(family: str, seed: int) -> Case:
    """Return the random problem of a family for a seed."""
    rng = np.random.default_rng([77, SPACE_FAMILIES.index(family), seed])
    case = _MAKERS[family](rng)
    name = f"space-{family.replace(' ', '-')}-{seed}"
    data = {"schema": 1, "space": 3, "name": name, **case.data}
    return Case(case.family, data, case.key, case.threshold, case.named, case.sign)


def _tables(rng: np.random.Generator, length: float, radius: float, **arm: Any) -> dict[str, Any]:
    """Return tables of a problem in a large empty workspace, with an arm at the origin, straight upwards.

    Args:
        rng: random generator.
        length: length of the arm [m].
        radius: radius of the arm [m].
        **arm: further keys of the table of the arm.
    """
    links = int(rng.choice([12, 16, 20, 24]))
    return {
        "workspace": {"bounds": [[-1.8, -1.8, -1.8], [1.8, 1.8, 1.8]], "obstacles": []},
        "arm": {
            "links": links,
            "link_length": length / links,
            "radius": radius,
            "base": {"position": [0.0, 0.0, 0.0], "direction": [0.0, 0.0, 1.0], "up": [-1.0, 0.0, 0.0]},
            "joint_limit_deg": 50.0,
            **arm,
        },
        "limits": {"velocity": 1.0, "acceleration": 2.0},
        "start": {"shape": "straight"},
        "goal": {"position": [0.0, 0.0, 0.0]},
        "planner": {"time_limit": 60.0},
    }


def _direction(rng: np.random.Generator) -> FloatArray:
    way = rng.normal(size=3)
    return np.asarray(way / np.linalg.norm(way))


def _too_short(rng: np.random.Generator) -> Case:
    """Return a case whose goal is too far away, in free space or around the upper edge of a wall."""
    share = rng.uniform(0.75, 0.95)
    radius = rng.uniform(0.012, 0.02)
    if rng.random() < 0.5:
        distance = rng.uniform(0.7, 1.2)
        data = _tables(rng, share * distance, radius)
        data["goal"]["position"] = (distance * _direction(rng)).tolist()
        need = distance
        named = ("out of reach",)
    else:
        ahead = rng.uniform(0.25, 0.4)
        height = rng.uniform(0.2, 0.4)
        goal = np.array([ahead + rng.uniform(0.2, 0.4), rng.uniform(-0.05, 0.1)])
        # A bar as upper edge keeps the string on a circle.
        bar = rng.uniform(0.02, 0.04)
        end = np.array([ahead, height])
        need = string_round(np.zeros(2), goal, end, radius + bar)
        data = _tables(rng, share * need, radius)
        across = 1.75
        data["workspace"]["obstacles"] = [
            {"name": "screen", "box": [[ahead - bar, -across, -1.75], [ahead + bar, across, height]]},
            {
                "name": "edge",
                "capsule": {"from": [ahead, -across, height], "to": [ahead, across, height], "radius": bar},
            },
        ]
        data["goal"]["position"] = [float(goal[0]), 0.0, float(goal[1])]
        named = ("'edge'",)
    links = data["arm"]["links"]
    return Case("too short", data, "arm.link_length", (need - TOLERANCE) / links, named, 1)


def _walls(ahead: float, depth: float, low: FloatArray, high: FloatArray) -> list[dict[str, Any]]:
    """Return tables of four boxes that form a wall across the workspace with one window."""
    far = 1.75
    near, back = ahead, ahead + depth
    return [
        {"name": "upper wall", "box": [[near, -far, float(high[1])], [back, far, far]]},
        {"name": "lower wall", "box": [[near, -far, -far], [back, far, float(low[1])]]},
        {"name": "left wall", "box": [[near, float(high[0]), float(low[1])], [back, far, float(high[1])]]},
        {"name": "right wall", "box": [[near, -far, float(low[1])], [back, float(low[0]), float(high[1])]]},
    ]


def _too_thick(rng: np.random.Generator) -> Case:
    """Return a case with a wall across the workspace whose single window is narrower than the arm and its clearance."""
    radius = rng.uniform(0.03, 0.045)
    clearance = float(rng.choice([0.0, 0.0, 0.004]))
    thick = radius / rng.uniform(0.65, 0.9)
    half = radius + clearance
    ahead = rng.uniform(0.35, 0.45)
    depth = rng.uniform(0.02, 0.08)
    middle = np.array([rng.uniform(-0.1, 0.1), rng.uniform(0.0, 0.2)])
    sides = half * np.array([1.0, rng.uniform(1.0, 3.0)])
    data = _tables(rng, rng.uniform(1.1, 1.3), thick)
    data["workspace"]["clearance"] = clearance
    data["workspace"]["obstacles"] = [
        *_walls(ahead, depth, middle - sides, middle + sides),
        {"name": "bystander", "sphere": {"center": [-1.2, 1.2, 0.0], "radius": 0.2}},
    ]
    data["goal"]["position"] = [
        ahead + depth + rng.uniform(0.15, 0.3),
        *(middle + rng.uniform(-0.05, 0.05, 2)).tolist(),
    ]
    return Case("too thick", data, "arm.radius", radius, ("'left wall'", "'right wall'"), -1)


def _too_stiff(rng: np.random.Generator) -> Case:
    """Return a case whose goal position or direction requires larger bend angles than allowed."""
    data = _tables(rng, rng.uniform(0.9, 1.3), rng.uniform(0.01, 0.02))
    arm = data["arm"]
    links = arm["links"]
    link = arm["link_length"]
    share = rng.uniform(0.6, 0.9)
    if rng.random() < 0.5:
        # A plane arc in the plane of the direction and the left: one bend of each joint, far from both at their limits.
        turn = np.deg2rad(rng.uniform(100.0, 165.0))
        bend = turn / links
        headings = bend * (1.0 + np.arange(links))
        steps = link * np.column_stack((np.sin(headings), np.cos(headings)))
        tip = steps.sum(axis=0)
        across = _direction(rng)[:2]
        across = across / np.linalg.norm(across)
        data["goal"] = {
            "position": [*(tip[0] * across).tolist(), float(tip[1])],
            "direction": [*(np.sin(turn) * across).tolist(), float(np.cos(turn))],
        }
        limit = _limit_of_turn(share * bend)
        arm["joint_limit_deg"] = float(np.rad2deg(limit))
        arm["base_limit_deg"] = arm["joint_limit_deg"]
        return Case("too stiff", data, "arm.joint_limit_deg", 0.0, ("cannot",), 1)
    distance = rng.uniform(0.15, 0.4) * links * link
    bend = brentq(lambda b: link * np.sin(0.5 * links * b) / np.sin(0.5 * b) - distance, 1e-6, 2.0 * np.pi / links)
    data["goal"]["position"] = (distance * _direction(rng)).tolist()
    arm["joint_limit_deg"] = float(np.rad2deg(_limit_of_turn(share * bend)))
    return Case("too stiff", data, "arm.joint_limit_deg", _limit_of_turn(float(bend)), ("cannot",), 1)


def _limit_of_turn(turn: float) -> float:
    """Return the limit β of both bend angles of a joint for a total angle γ of the joint, cos² β = cos γ [rad]."""
    return float(np.arccos(np.sqrt(np.cos(turn))))


def _blocked(rng: np.random.Generator) -> Case:
    """Return a case with a wall across the workspace whose single window is closed by one of several obstacles."""
    ahead = rng.uniform(0.35, 0.45)
    depth = rng.uniform(0.05, 0.1)
    middle = np.array([rng.uniform(-0.1, 0.1), rng.uniform(0.0, 0.2)])
    sides = rng.uniform(0.09, 0.14, 2)
    low = middle - sides
    high = middle + sides
    data = _tables(rng, rng.uniform(1.1, 1.3), rng.uniform(0.015, 0.025))
    lap = rng.uniform(0.004, 0.02)
    shutter = {
        "name": "shutter",
        "box": [
            [ahead + 0.2 * depth, *(low - lap).tolist()],
            [ahead + 0.6 * depth, *(high + lap).tolist()],
        ],
    }
    others = [
        {"name": f"ball {k}", "sphere": {"center": [-1.0 + 0.4 * k, 1.2, -0.4], "radius": rng.uniform(0.03, 0.1)}}
        for k in range(3)
    ]
    data["workspace"]["obstacles"] = [*others, *_walls(ahead, depth, low, high), shutter]
    data["goal"]["position"] = [
        ahead + depth + rng.uniform(0.15, 0.3),
        *(middle + rng.uniform(-0.05, 0.05, 2)).tolist(),
    ]
    return Case("blocked", data, "workspace.obstacles", "shutter", ("'shutter'",))


def _contact(rng: np.random.Generator) -> Case:
    """Return a case with a ball in contact with the start, a goal pose of the whole arm, or the tip goal."""
    thick = rng.uniform(0.03, 0.045)
    data = _tables(rng, rng.uniform(1.0, 1.3), thick)
    links = data["arm"]["links"]
    link = data["arm"]["link_length"]
    which = str(rng.choice(["start", "goal", "tip"]))
    gap = rng.uniform(0.6, 0.93) * thick
    ball = rng.uniform(0.02, 0.06)
    number = int(rng.integers(links // 3, links - 2))
    angle = rng.uniform(-np.pi, np.pi)
    across = np.array([np.cos(angle), np.sin(angle), 0.0])
    if which == "start":
        middle = (gap + ball) * across + np.array([0.0, 0.0, (number + 0.5) * link])
        data["goal"] = {"position": (0.7 * links * link * np.array([-across[0], -across[1], 0.3])).tolist()}
        named = ("'ball'", f"link {number + 1}")
        threshold = gap
    elif which == "goal":
        # The whole arm, turned over by its first joint alone.
        over = float(rng.choice([-1.0, 1.0])) * rng.uniform(60.0, 110.0)
        data["goal"] = {"joints_deg": [[0.0, over], *[[0.0, 0.0]] * (links - 1)]}
        # The first joint's second bend turns from the direction, z, towards minus up: that is +x for up = −x.
        way = np.array([np.sin(np.deg2rad(over)), 0.0, np.cos(np.deg2rad(over))])
        beside = np.array([-way[2], 0.0, way[0]]) * np.cos(angle) + np.array([0.0, 1.0, 0.0]) * np.sin(angle)
        middle = (number + 0.5) * link * way + (gap + ball) * beside
        named = ("'ball'", f"link {number + 1}")
        threshold = gap
    else:
        tip = 0.75 * links * link * (0.8 * across + np.array([0.0, 0.0, 0.6]))
        middle = tip + (gap + ball) * across
        data["goal"] = {"position": tip.tolist()}
        named = ("'ball'", "the tip")
        threshold = gap + TOLERANCE
    data["workspace"]["obstacles"] = [{"name": "ball", "sphere": {"center": middle.tolist(), "radius": ball}}]
    return Case("contact", data, "arm.radius", float(threshold), named, -1)


def _torque(rng: np.random.Generator) -> Case:
    """Return a case with a torque limit too low to hold the start or a goal pose of the whole arm."""
    data = _tables(rng, rng.uniform(0.6, 1.2), rng.uniform(0.01, 0.03))
    links = data["arm"]["links"]
    link = data["arm"]["link_length"]
    mass = rng.uniform(0.03, 0.2)
    data["arm"]["link_mass"] = mass
    over = rng.uniform(60.0, 110.0)
    need = links * mass * GRAVITY * 0.5 * links * link * np.sin(np.deg2rad(over))
    data["limits"]["torque"] = float(rng.uniform(0.5, 0.93) * need)
    weak = {"joints_deg": [[0.0, over], *[[0.0, 0.0]] * (links - 1)]}
    if rng.random() < 0.5:
        data["start"] = weak
        data["goal"] = {"position": [0.0, 0.1, 0.93 * links * link]}
    else:
        data["goal"] = weak
    return Case("torque", data, "limits.torque", float(need), ("joint 1 ",), 1)


_MAKERS: dict[str, Callable[[np.random.Generator], Case]] = {
    "too short": _too_short,
    "too thick": _too_thick,
    "too stiff": _too_stiff,
    "blocked": _blocked,
    "contact": _contact,
    "torque": _torque,
}
