"""Lead the tip along a given path, past a post.

The path is a function of the path parameter u, which runs from 0 at the start to 1 at the goal; two equations tie the
tip to it. How fast u grows is left to the retiming. The path has to begin where the tip is at the start. Run it with
the name of a picture, or without one::

    python examples/04_follow_a_tip_path.py path.png
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import shapely

import ccm_opt
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.scene.workspace import Obstacle, PlaneShape

OPEN_SPACE = Path(__file__).parent.parent / "problems" / "open-space.toml"
START_BEND = np.deg2rad(110.0)
BEND = np.deg2rad(-4.0)
SWAY = 0.06


def weld() -> Problem:
    """The open space with a post in it; the arm starts as an arc."""
    problem = ccm_opt.load_problem(OPEN_SPACE)
    bends = np.full(problem.arm.links, BEND)
    bends[0] = START_BEND
    post = Obstacle("post", PlaneShape(shapely.Point(0.35, 0.25), 0.06))
    return replace(
        problem,
        name="follow-a-tip-path",
        workspace=replace(problem.workspace, obstacles=(post,)),
        start=JointPose(bends),
        goal=TipGoal(np.array([0.8, 0.2])),
    )


PROBLEM = weld()
FIRST = PROBLEM.arm.joint_positions(PROBLEM.arm.headings(PROBLEM.start.bends))[-1]
LAST = PROBLEM.goal.position
ACROSS = np.array([LAST[1] - FIRST[1], FIRST[0] - LAST[0]]) / np.hypot(*(LAST - FIRST))


def seam(u: Any, sine: Any) -> tuple[Any, Any]:
    """The path: from first to last point, one wave to both sides."""
    wave = SWAY * sine(2.0 * np.pi * u)
    return tuple(FIRST[k] + u * (LAST[k] - FIRST[k]) + wave * ACROSS[k] for k in (0, 1))


@ccm_opt.constraint(lower=0.0, upper=0.0)
def tip_on_the_seam(q: ccm_opt.Quantities) -> ca.SX:
    """Distance of the tip from its place on the path [m]."""
    return q.tip - ca.vertcat(*seam(q.path_parameter, ca.sin))


def main() -> None:
    """Solve, report, draw."""
    solution = ccm_opt.solve(PROBLEM, constraints=[tip_on_the_seam])
    check = solution.checks[-1]
    print(f"{solution.problem.name}: {solution.trajectory.duration:.2f} s")
    print(f"  {check.name}: residual {check.worst:.2g} at most, allowed {check.limit:g}")
    if len(sys.argv) > 1:
        draw(solution, Path(sys.argv[1]))


def draw(solution: ccm_opt.Solution, file: Path) -> None:
    """The plan with the given path below that of the tip."""
    figure = solution.plot()
    figure.axes[0].plot(*seam(np.linspace(0.0, 1.0, 200), np.sin), color="tab:red", linewidth=4.0, alpha=0.4, zorder=4)
    figure.savefig(file)


if __name__ == "__main__":
    main()
