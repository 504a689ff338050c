"""A tour of five views that bends the mast less: a cost of your own.

The job of problems/jobs/five-views.toml. The arm hangs from a slim mast, and the farther it reaches out, the more it
bends the mast. The cost is the square of the moment at the arm's base, averaged over the keyframes of every leg, and
weighed against the length of the joint path. Views, limits and walls stay what they are; only the way changes. Run it
with the name of a picture, or without one::

    python examples/11_tour_easy_on_the_mast.py tour.png
"""

import sys
from pathlib import Path

import casadi as ca
import numpy as np

import ccm_opt

JOB = Path(__file__).parent.parent / "problems" / "jobs" / "five-views.toml"
GRAVITY = 9.81


@ccm_opt.cost(weight=1e-4)
def mast_moment(q: ccm_opt.Quantities) -> ca.SX:
    """Squared moment of the hanging arm and its camera about the base [N² m²]."""
    x = q.joint_positions[0, :].T
    middles = 0.5 * (x[1:] + x[:-1])
    return (GRAVITY * (ca.dot(ca.DM(q.arm.masses), middles) + q.arm.payload * x[-1])) ** 2


def moments(solution: ccm_opt.Solution) -> np.ndarray:
    """The moment about the base at every sample of the motion, arm at rest, shape (T,) [N m]."""
    arm = solution.problem.arm
    x = solution.joint_positions[:, :, 0]
    return GRAVITY * (0.5 * (x[:, 1:] + x[:, :-1]) @ arm.masses + arm.payload * x[:, -1])


def main() -> None:
    """Solve without the cost and with it, report, draw."""
    job = ccm_opt.load_problem(JOB)
    for words, costs in (("without the cost", []), ("with the cost", [mast_moment])):
        solution = ccm_opt.solve(job, costs=costs)
        found = np.sqrt(np.mean(moments(solution) ** 2))
        print(f"{words}: moment {found:.1f} N m (root mean square), {solution.trajectory.duration:.1f} s")
    if len(sys.argv) > 1:
        solution.plot().savefig(Path(sys.argv[1]))


if __name__ == "__main__":
    main()
