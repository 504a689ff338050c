"""Look at a spot on the back of a wall, in space: constraints on where a camera points, and a cost of one's own.

The room of problems/space/swan-neck-in-space.toml. Where the tip ends is given, and that the camera has the spot
within four degrees of its axis, not nearer than it can focus; from which side it looks, and how the arm comes there, is
left to the planner, which turns the joint at the base as little as it can. Run it with the name of a picture, or
without one::

    python examples/12_look_at_a_spot_in_space.py look.png

The same from the command line, for a problem file of your own::

    ccm-opt solve mine.toml --constraint examples/12_look_at_a_spot_in_space.py:CONSTRAINTS
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

import ccm_opt
from ccm_opt.problem import TipGoal
from ccm_opt.viz.arm_drawing import PlanDrawing
from ccm_opt.viz.plan import plan_picture

ROOM = Path(__file__).parent.parent / "problems" / "space" / "swan-neck-in-space.toml"
SPOT = np.array([0.252, 0.05, 0.22])
"""On the back of the hanging wall [m]."""
WITHIN = np.deg2rad(4.0)
"""Half the angle of the picture that counts as its middle; assumed [rad]."""
NEAREST = 0.15
"""At which the camera can focus; assumed [m]."""


@ccm_opt.constraint(name="spot in the middle", lower=float(np.cos(WITHIN)), where="goal")
def in_the_middle(q: Any) -> ca.SX:
    """Cosine of the angle between the last link and the way to the spot."""
    way = ca.DM(SPOT) - q.tip
    return ca.dot(q.tip_direction, way) / ca.norm_2(way)


@ccm_opt.constraint(name="spot in focus", lower=NEAREST, where="goal")
def in_focus(q: Any) -> ca.SX:
    """Distance of the spot along the last link [m]."""
    return ca.dot(q.tip_direction, ca.DM(SPOT) - q.tip)


CONSTRAINTS = [in_the_middle, in_focus]


@ccm_opt.cost(weight=0.5)
def little_turning_at_the_base(q: Any) -> ca.SX:
    """Squared bends of the first joint, a and b [rad²]."""
    return ca.sumsqr(q.joint_angles[:, 0])


def main() -> None:
    """Solve, report, draw."""
    room = ccm_opt.load_problem(ROOM)
    problem = replace(room, name="look-at-a-spot", goal=TipGoal(np.array([0.40, 0.12, 0.02])))
    solution = ccm_opt.solve(problem, constraints=CONSTRAINTS, costs=[little_turning_at_the_base])
    joints = solution.joint_positions[-1]
    along = (joints[-1] - joints[-2]) / np.linalg.norm(joints[-1] - joints[-2])
    way = SPOT - joints[-1]
    off = np.rad2deg(np.arccos(along @ way / np.linalg.norm(way)))
    print(f"{solution.trajectory.duration:.1f} s; the spot is {off:.1f}° off the camera's axis")
    for check in solution.checks[-len(CONSTRAINTS) :]:
        print(f"  {check.name}: residual {check.worst:.2g} at most, allowed {check.limit:g}")
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_bytes(plan_picture(PlanDrawing.from_solution(solution)))


if __name__ == "__main__":
    main()
