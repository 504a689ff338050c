"""Drive the tip round in a level plane by velocities, as a hand would, and keep the motion as a plan.

The room of problems/space/swan-neck-in-space.toml. A tick lasts ten milliseconds; what keeps the tip from following is
told once for each reason. Run it with a folder for the plan, or without one::

    python examples/13_drive_by_hand.py runs
"""

import sys
from pathlib import Path

import numpy as np

import ccm_opt

ROOM = Path(__file__).parent.parent / "problems" / "space" / "swan-neck-in-space.toml"
TICKS = 100
SPEED = 0.1
"""Greatest speed of the tip [m/s]."""


def main() -> None:
    """Drive, report, brake, save."""
    servo = ccm_opt.Servo(ccm_opt.load_problem(ROOM))
    told: set[str] = set()
    for tick in range(TICKS):
        angle = 2.0 * np.pi * tick / TICKS
        speed = SPEED * np.sin(0.5 * angle)  # a hand starts and ends gently
        step = servo.step(ccm_opt.Twist((speed * np.cos(angle), speed * np.sin(angle), 0.0)))
        for reason in step.reasons:
            if (kind := reason.split(":")[0]) not in told:
                told.add(kind)
                print(f"{step.time:.2f} s, {step.lost:.0%} of the velocity is lost: {reason}")
    braking = servo.brake()
    solution = servo.solution()
    passed = sum(check.passed for check in solution.checks)
    print(f"braked in {braking.duration:.2f} s; {solution.trajectory.duration:.2f} s driven, {passed} checks passed")
    if len(sys.argv) > 1:
        print(solution.save(sys.argv[1]))


if __name__ == "__main__":
    main()
