"""Look at a weld: two constraints on where the camera at the tip looks when it has arrived.

The tank of problems/jobs/five-views.toml, with a weld on the left pipe in place of the views. Where the tip ends is
given, and that the camera has the weld in the middle of its picture, not nearer than it can focus; which heading that
is, and how the arm comes to it, is left to the planner. Run it with the name of a picture, or without one::

    python examples/10_look_at_a_weld.py look.png

The same from the command line, for a problem file of your own::

    ccm-opt solve mine.toml --constraint examples/10_look_at_a_weld.py:CONSTRAINTS
"""

import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

import ccm_opt
from ccm_opt.problem import Problem, TipGoal

JOB = Path(__file__).parent.parent / "problems" / "jobs" / "five-views.toml"
WELD = np.array([-1.15, -0.75])
"""On the far side of the left pipe [m]."""
NEAREST = 0.15
"""At which the camera can focus; assumed [m]."""


@ccm_opt.constraint(name="weld in the middle", lower=0.0, upper=0.0, where="goal")
def aside(q: ccm_opt.Quantities) -> ca.SX:
    """Distance of the weld from the line of sight [m]."""
    way = ca.DM(WELD) - q.tip
    return way[0] * ca.sin(q.tip_heading) - way[1] * ca.cos(q.tip_heading)


@ccm_opt.constraint(name="weld in focus", lower=NEAREST, where="goal")
def ahead(q: ccm_opt.Quantities) -> ca.SX:
    """Distance of the weld along the line of sight [m]."""
    way = ca.DM(WELD) - q.tip
    return way[0] * ca.cos(q.tip_heading) + way[1] * ca.sin(q.tip_heading)


CONSTRAINTS = [aside, ahead]


def inspection() -> Problem:
    """The tank with one place for the tip, behind the left pipe, and no heading asked for."""
    job = ccm_opt.load_problem(JOB)
    return replace(job, name="look-at-a-weld", stops=(), goal=TipGoal(np.array([-1.4, -1.0])))


def main() -> None:
    """Solve, report, draw."""
    solution = ccm_opt.solve(inspection(), constraints=CONSTRAINTS)
    heading = solution.problem.arm.headings(solution.trajectory.bend_angles[-1])[-1]
    print(f"{solution.trajectory.duration:.1f} s; the camera looks along {np.rad2deg(heading) % 360.0:.1f}°")
    for check in solution.checks[-len(CONSTRAINTS) :]:
        print(f"  {check.name}: residual {check.worst:.2g} at most, allowed {check.limit:g}")
    if len(sys.argv) > 1:
        figure = solution.plot()
        figure.axes[0].plot(*np.stack((solution.joint_positions[-1, -1], WELD)).T, color="tab:red", linewidth=1.5)
        figure.savefig(Path(sys.argv[1]))


if __name__ == "__main__":
    main()
