"""Keep the middle third of the arm above a line.

The constraint is a vector: the heights of the joints from a third to two thirds of the arm, all with one lower bound.
Without it the middle sags as the arm reaches out; the script solves the problem with and without it, and compares. Run
it with the name of a picture, or without one::

    python examples/03_keep_the_middle_up.py middle.png
"""

import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

import ccm_opt
from ccm_opt.problem import Problem, TipGoal

OPEN_SPACE = Path(__file__).parent.parent / "problems" / "open-space.toml"
LINE = 0.27


@ccm_opt.constraint(lower=LINE)
def middle_third_above_the_line(q: ccm_opt.Quantities) -> ca.SX:
    """Heights of the joints in the middle third [m]."""
    third = q.arm.links // 3
    return q.joint_positions[1, third : 2 * third + 1]


def reaching() -> Problem:
    """The open space with a goal that is far out and low, whatever its heading."""
    problem = ccm_opt.load_problem(OPEN_SPACE)
    return replace(problem, name="keep-the-middle-up", goal=TipGoal(np.array([0.8, 0.1])))


def lowest(solution: ccm_opt.Solution) -> float:
    """Least height of the middle third over all samples [m]."""
    third = solution.problem.arm.links // 3
    return float(solution.joint_positions[:, third : 2 * third + 1, 1].min())


def main() -> None:
    """Solve with the line and without, report, draw."""
    problem = reaching()
    plain = ccm_opt.solve(problem)
    solution = ccm_opt.solve(problem, constraints=[middle_third_above_the_line])
    for name, each in (("without the line", plain), ("above the line", solution)):
        print(f"{name}: lowest at {lowest(each):.4f} m, {each.trajectory.duration:.2f} s")
    check = solution.checks[-1]
    print(f"  {check.name}: residual {check.worst:.2g} at most, allowed {check.limit:g}")
    if len(sys.argv) > 1:
        draw(solution, Path(sys.argv[1]))


def draw(solution: ccm_opt.Solution, file: Path) -> None:
    """The plan with the line, and the middle third at the goal."""
    figure = solution.plot()
    third = solution.problem.arm.links // 3
    axes = figure.axes[0]
    axes.axhline(LINE, color="tab:red", linewidth=1.0, linestyle=":", zorder=7)
    for k in (0, -1):
        axes.plot(*solution.joint_positions[k, third : 2 * third + 1].T, color="tab:red", linewidth=2.0, zorder=8)
    figure.savefig(file)


if __name__ == "__main__":
    main()
