"""Solve a problem from Python, look at the result, and verify it once more.

Run it with a problem file, or without one for the swan's neck of section 5 of A. Hayashi, J. Park and B. J. Kuipers,
*Toward Planning and Control of Highly Redundant Manipulators* (1990)::

    python examples/01_solve.py problems/s-duct.toml
"""

import sys
from pathlib import Path

import ccm_opt

SWAN_NECK = Path(__file__).parent.parent / "problems" / "swan-neck.toml"


def main() -> None:
    """Solve the problem named on the command line."""
    problem = ccm_opt.load_problem(sys.argv[1] if len(sys.argv) > 1 else SWAN_NECK)
    solution = ccm_opt.solve(problem, progress=lambda stage: print(f"... {stage}"))
    tip = solution.joint_positions[-1, -1]
    print(f"{problem.name}: {solution.trajectory.duration:.2f} s, the tip ends at ({tip[0]:.4f}, {tip[1]:.4f}) m")
    for check in ccm_opt.check(problem, solution.trajectory, solution.joints):
        print(f"  {'ok   ' if check.passed else 'fails'} {check.name}: {check.worst:.4g} {check.unit}, {check.where}")


if __name__ == "__main__":
    main()
