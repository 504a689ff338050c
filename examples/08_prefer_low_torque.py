"""A cost that prefers poses that are easy to hold.

The cost is the sum of squared holding torques: at every joint, gravity times the masses beyond it times their
horizontal distances. It is averaged over the motion and weighed against the length of the joint path; the script
solves without it and with two weights. The optimisation finds the minimum nearest to the motion that the search found:
here the end of the arm curls up near the goal. The peak torque does not fall, for it includes what acceleration takes.
Run it with the name of a picture, or without one::

    python examples/08_prefer_low_torque.py torque.png
"""

import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np

import ccm_opt
from ccm_opt.problem import JointPose, Problem, TipGoal

OPEN_SPACE = Path(__file__).parent.parent / "problems" / "open-space.toml"
GRAVITY = 9.81
WEIGHTS = (0.03, 0.2)


def holding_torques(q: ccm_opt.Quantities) -> ca.SX:
    """Torque that every joint needs to hold the arm still, shape (links, 1) [N m]."""
    x = q.joint_positions[0, :].T
    middles = 0.5 * (x[1:] + x[:-1])
    masses = ca.DM(q.arm.masses)
    beyond = ca.DM(np.triu(np.ones((q.arm.links, q.arm.links))))
    return GRAVITY * (beyond @ (masses * middles) - x[:-1] * (beyond @ masses))


@ccm_opt.cost()
def holding_effort(q: ccm_opt.Quantities) -> ca.SX:
    """Sum of the squared holding torques [N² m²]."""
    return ca.sumsqr(holding_torques(q))


def swing() -> Problem:
    """The open space: from reaching left to reaching right, over the base."""
    problem = ccm_opt.load_problem(OPEN_SPACE)
    bends = np.full(problem.arm.links, np.deg2rad(2.0))
    bends[0] = np.deg2rad(120.0)
    return replace(
        problem, name="prefer-low-torque", start=JointPose(bends), goal=TipGoal(np.array([0.55, 0.3]), heading=-0.2)
    )


def main() -> None:
    """Solve without the cost and with it, report, draw."""
    problem = swing()
    solution = None
    for weight in (0.0, *WEIGHTS):
        solution = ccm_opt.solve(problem, costs=[replace(holding_effort, weight=weight)])
        figures = solution.metrics
        print(
            f"weight {weight:g}: mean holding effort {figures['cost_holding_effort']:.3f} N²m², "
            f"peak torque {figures['peak_torque_Nm']:.2f} N m, {solution.trajectory.duration:.2f} s"
        )
    if solution is not None and len(sys.argv) > 1:
        solution.plot().savefig(Path(sys.argv[1]))


if __name__ == "__main__":
    main()
