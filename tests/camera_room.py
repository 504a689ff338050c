"""A room with one post, and a camera at the tip that has to keep a valve in sight: problems for users' terms."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np

import ccm_opt
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Problem

VALVE = (0.9, 0.75)
"""What the camera looks at [m]."""
VIEW = float(np.tan(np.deg2rad(10.0)))
"""Slope of the edge of the camera's view."""
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
    """The problem; its start keeps the valve in view."""
    return parse_problem(ROOM, "camera-room.toml")


@ccm_opt.constraint(name="valve in view", upper=0.0)
def valve_in_view(q: ccm_opt.Quantities) -> ca.SX:
    """The valve is within ten degrees of where the last link points."""
    way = ca.DM(VALVE) - q.tip
    sight = ca.vertcat(ca.cos(q.tip_heading), ca.sin(q.tip_heading))
    along = ca.dot(way, sight)
    aside = way[0] * sight[1] - way[1] * sight[0]
    return ca.vertcat(aside - VIEW * along, -aside - VIEW * along)


@ccm_opt.cost(name="high tip")
def high_tip(q: ccm_opt.Quantities) -> ca.SX:
    """How far the tip is from a height that it can pass on its way."""
    return (q.tip[1] - 0.9) ** 2


@ccm_opt.constraint(name="left of the goal", upper=0.65)
def left_of_the_goal(q: ccm_opt.Quantities) -> ca.SX:
    """Contradicts the goal, which lies a tenth of a metre to the right of it."""
    return q.tip[0]


def weighted(cost: ccm_opt.Cost, weight: float) -> ccm_opt.Cost:
    """A cost with another weight."""
    return replace(cost, weight=weight)
