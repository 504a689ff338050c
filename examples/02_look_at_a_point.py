"""Keep the camera at the tip on a gauge while the arm moves round it.

One equation and one inequality hold over the whole motion: the line of sight passes through the gauge's middle, and
the gauge is ahead of the camera. The start has to look at the gauge already, or ``solve`` would say so before it plans;
``find_pose`` finds one that does. The residual is that of the trajectory at 1 kHz, and ``solve`` refuses anything above
1e-6. Run it with the name of a picture, or without one::

    python examples/02_look_at_a_point.py look.png

The same from the command line, for a problem file of your own::

    ccm-opt solve room.toml --constraint examples/02_look_at_a_point.py:CONSTRAINTS
"""

import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import shapely

import ccm_opt
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.scene.workspace import Obstacle, PlaneShape

OPEN_SPACE = Path(__file__).parent.parent / "problems" / "open-space.toml"
GAUGE = np.array([0.53853837, 0.86661361])


@ccm_opt.constraint(name="look at the gauge", lower=0.0, upper=0.0)
def aside(q: ccm_opt.Quantities) -> ca.SX:
    """Distance of the gauge from the line of sight [m]."""
    way = ca.DM(GAUGE) - q.tip
    return way[0] * ca.sin(q.tip_heading) - way[1] * ca.cos(q.tip_heading)


@ccm_opt.constraint(name="gauge ahead", lower=0.1)
def ahead(q: ccm_opt.Quantities) -> ca.SX:
    """Distance of the gauge along the line of sight [m]."""
    way = ca.DM(GAUGE) - q.tip
    return way[0] * ca.cos(q.tip_heading) + way[1] * ca.sin(q.tip_heading)


CONSTRAINTS = [aside, ahead]


def inspection() -> Problem:
    """The open space with a gauge in it, and a start that keeps the gauge in view: the best such pose at its place."""
    problem = ccm_opt.load_problem(OPEN_SPACE)
    gauge = Obstacle("gauge", PlaneShape(shapely.Point(GAUGE), 0.03))
    bends = np.full(problem.arm.links, np.deg2rad(-5.0))
    bends[0] = np.deg2rad(130.0)
    place = problem.arm.joint_positions(problem.arm.headings(bends))[-1]
    near = replace(
        problem,
        name="look-at-a-point",
        workspace=replace(problem.workspace, obstacles=(gauge,)),
        start=JointPose(bends),
        goal=TipGoal(place),
    )
    start = ccm_opt.find_pose(near, constraints=CONSTRAINTS)
    return replace(near, start=JointPose(start.bends), goal=TipGoal(np.array([0.8, 0.5])))


def main() -> None:
    """Solve, report, draw."""
    problem = inspection()
    # The pose at the goal keeps the constraints from the beginning: they are rows of the program that finds it.
    pose = ccm_opt.find_pose(problem, constraints=CONSTRAINTS).pose
    for name, multiplier in pose.multipliers.items():
        if name.startswith("user: "):
            print(f"at the goal, {name.removeprefix('user: ')}: multiplier {multiplier:.3g}")

    solution = ccm_opt.solve(problem, constraints=CONSTRAINTS)
    print(f"{solution.problem.name}: {solution.trajectory.duration:.2f} s")
    for check in solution.checks[-len(CONSTRAINTS) :]:
        print(f"  {check.name}: residual {check.worst:.2g} at most, allowed {check.limit:g}")
    if len(sys.argv) > 1:
        draw(solution, Path(sys.argv[1]))


def draw(solution: ccm_opt.Solution, file: Path) -> None:
    """The plan with lines of sight."""
    figure = solution.plot()
    points = solution.joint_positions
    for k in np.linspace(0, len(points) - 1, 9).astype(int):
        figure.axes[0].plot(*np.stack((points[k, -1], GAUGE)).T, color="tab:red", linewidth=0.7, zorder=7)
    figure.savefig(file)


if __name__ == "__main__":
    main()
