"""A room with one post, and an arm whose camera at the tip must see a valve: problem and user terms for tests."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np

import ccm_opt
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Problem

VALVE = (0.9, 0.75)
"""Position of the valve that the camera must see [m]."""
VIEW = float(np.tan(np.deg2rad(10.0)))
"""Tangent of half the camera's angle of view."""
ROOM = """\
schema = 1
name = "camera room"

[workspace]
bounds = [-1.6, -1.2, 1.8, 1.6]
clearance = 0.005

[[workspace.obstacles]]
name = "pillar"
circle = { center = [0.3, 0.05], radius = 0.06 }

[arm]
links = 24
link_length = 0.05
link_mass = 0.08
radius = 0.02
base = [0.0, 0.0]
base_heading_deg = 90.0
base_limit_deg = 120.0
joint_limit_deg = 30.0

[limits]
velocity = 1.0
acceleration = 4.0
torque = 20.0

[start]
joints_deg = [20, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5, -5]

[goal]
position = [0.75, 0.2]

[planner]
time_limit = 60
"""


@cache
def camera_room() -> Problem:
    """Return the problem of the room; at the start, the camera sees the valve."""
    return parse_problem(ROOM, "camera-room.toml")


@ccm_opt.constraint(name="valve in view", upper=0.0)
def valve_in_view(q: ccm_opt.Quantities) -> ca.SX:
    """Return two values that are at most 0 if the valve is within 10° of the direction of the last link."""
    way = ca.DM(VALVE) - q.tip
    sight = ca.vertcat(ca.cos(q.tip_heading), ca.sin(q.tip_heading))
    along = ca.dot(way, sight)
    aside = way[0] * sight[1] - way[1] * sight[0]
    return ca.vertcat(aside - VIEW * along, -aside - VIEW * along)


@ccm_opt.cost(name="high tip")
def high_tip(q: ccm_opt.Quantities) -> ca.SX:
    """Return the squared distance of the tip from the height 0.9 m, as a cost."""
    return (q.tip[1] - 0.9) ** 2


@ccm_opt.constraint(name="left of the goal", upper=0.65)
def left_of_the_goal(q: ccm_opt.Quantities) -> ca.SX:
    """Return the x coordinate of the tip [m], bounded by 0.65 m, which contradicts the goal at 0.75 m."""
    return q.tip[0]


def weighted(cost: ccm_opt.Cost, weight: float) -> ccm_opt.Cost:
    """Return a cost with another weight."""
    return replace(cost, weight=weight)
