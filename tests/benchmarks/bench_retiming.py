"""Retiming: user CPU and how well limits hold between samples; prints a Markdown table.

    python -m tests.benchmarks.bench_retiming --paths 200
    python -m tests.benchmarks.bench_retiming --paths 50 --links 24 48 96

Random paths of an arm of equal links (the swan's neck of section 5.4), 2 rad/s and 10 rad/s², torque limited to 1.5
times what holds the arm still anywhere on the path. *Winding* paths have 4 to 29 control points with some legs halved
and some points doubled, *smooth* ones 8 control points, *crooked* ones 30 with a change of direction at each,
*turning* ones stop and turn off three times. The motion is timed with samples 4 ms apart; then the same motion, path
and speeds, is looked at every millisecond, with torques of the verifier's own recursion. Set OMP_NUM_THREADS=1 and
OPENBLAS_NUM_THREADS=1.
"""

# ruff: noqa: T201 - a benchmark prints its figures
import argparse
import resource
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import RetimingError
from ccm_opt.dynamics.retiming import retime, timing
from ccm_opt.dynamics.retiming.motion_samples import MotionSamples
from ccm_opt.dynamics.retiming.timing import Profile, sample_motion
from ccm_opt.dynamics.runtime.inverse_dynamics import InverseDynamics
from ccm_opt.problem import Limits
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import revolute_angles
from tests.arms import joint_torques
from tests.dynamics_arms import swan_neck

GRAVITY = np.array([0.0, 0.0, -9.81])
TORQUE_ROOM = 1.5
"""Torque limit over the greatest torque that holds the arm still on the path."""
LOOK = 1e-3
"""Time between two looks [s]."""
COLUMNS = (
    "paths",
    "links",
    "path",
    "jerk limit",
    "CPU, median [ms]",
    "90 %",
    "longest",
    "duration, median [s]",
    "worst velocity",
    "acceleration",
    "jerk",
    "torque",
    "failed",
)


def winding(rng: np.random.Generator, links: int) -> FloatArray:
    """Control points of a random walk, some legs halved as the planner does, some points repeated."""
    control = np.cumsum(rng.normal(0.0, 0.09, (int(rng.integers(4, 30)), links)), axis=0)
    halved = rng.integers(1, len(control), 3)
    control = np.insert(control, halved, 0.5 * (control[halved] + control[halved - 1]), axis=0)
    return np.repeat(control, rng.choice([1, 2], len(control), p=[0.9, 0.1]), axis=0)


def smooth(rng: np.random.Generator, links: int) -> FloatArray:
    """Control points of a gentle curve."""
    return np.cumsum(rng.normal(0.0, 0.09, (8, links)), axis=0)


def crooked(rng: np.random.Generator, links: int) -> FloatArray:
    """Control points that jump to and fro beside a straight line."""
    along = np.linspace(0.0, 1.0, 30)[:, None] * rng.normal(0.0, 0.3, links)
    return along + rng.normal(0.0, 0.05, (30, links))


def turning(rng: np.random.Generator, links: int) -> FloatArray:
    """Control points of straight legs to and fro, three at each turn, at which the path stops."""
    corners = rng.normal(0.0, 0.2, (5, links))
    legs = [a + np.linspace(0.0, 1.0, 5)[1:-1, None] * (b - a) for a, b in pairwise(corners)]
    pieces = [points for corner, leg in zip(corners, legs, strict=False) for points in (np.tile(corner, (3, 1)), leg)]
    return np.concatenate((*pieces, np.tile(corners[-1], (3, 1))))


KINDS: Mapping[str, Callable[[np.random.Generator, int], FloatArray]] = {
    "winding": winding,
    "smooth": smooth,
    "crooked": crooked,
    "turning": turning,
}


@dataclass(frozen=True)
class Figures:
    """What came of one path; shares of limits are 0 where there is none.

    Attributes:
        seconds: user CPU [s].
        duration: of the motion [s].
        shares: greatest share of the velocity, acceleration, jerk and torque limits at any look.
    """

    seconds: float
    duration: float
    shares: FloatArray


def make_path(control: FloatArray) -> JointPath:
    """A clamped uniform cubic spline over [0, 1]."""
    knots = np.concatenate((np.zeros(3), np.linspace(0.0, 1.0, len(control) - 2), np.ones(3)))
    return JointPath(BSpline(knots, control, 3), control, ())


def make_limits(arm: Arm, path: JointPath, jerk: float | None) -> Limits:
    """Limits that leave some room above the static load."""
    ones = np.ones(3 * arm.links)
    bends = path.spline(np.linspace(0.0, 1.0, 400))
    static = np.abs(joint_torques(arm, GRAVITY, bends, np.zeros_like(bends), np.zeros_like(bends))).max()
    return Limits(2.0 * ones, 10.0 * ones, TORQUE_ROOM * static * ones, jerk=None if jerk is None else jerk * ones)


class Recorder:
    """Stands in for ``sample_motion`` and keeps the profile it was last called with."""

    def __init__(self) -> None:
        self.profile: Profile | None = None

    def __call__(self, spline: BSpline, profile: Profile, *rest: object) -> MotionSamples:
        """Sample as ever."""
        self.profile = profile
        return sample_motion(spline, profile, *rest)  # type: ignore[arg-type]


def user_seconds() -> float:
    """User CPU of this process so far [s]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_utime


def measure(arm: Arm, dynamics: InverseDynamics, path: JointPath, limits: Limits) -> Figures:
    """Time a path, and look closely at the motion."""
    recorder = Recorder()
    timing.sample_motion = recorder  # type: ignore[assignment]
    begin = user_seconds()
    trajectory = retime(
        path, limits, dynamics, revolutes=partial(revolute_angles, arm), link_lengths=arm.lengths, step=4e-3
    )
    seconds = user_seconds() - begin
    if recorder.profile is None:
        raise RuntimeError("the motion was not sampled")
    profile = recorder.profile.slowed(trajectory.duration / recorder.profile.duration)
    return Figures(seconds, trajectory.duration, shares(arm, limits, path, profile))


def shares(arm: Arm, limits: Limits, path: JointPath, profile: Profile) -> FloatArray:
    """Greatest shares of the limits at looks every millisecond."""
    motion: JointTrajectory = sample_motion(path.spline, profile, LOOK, None, arm.coordinates).trajectory(
        arm.coordinates
    )
    bends = slice(1, None, 3)
    torques = joint_torques(arm, GRAVITY, motion.bend_angles, motion.bend_velocities, motion.bend_accelerations)
    jerks = np.diff(motion.bend_accelerations, axis=0) / np.diff(motion.time)[:, None]
    values = (motion.bend_velocities, motion.bend_accelerations, jerks, torques)
    bounds = (limits.velocity[bends], limits.acceleration[bends], limits.jerk, limits.torque)
    return np.array(
        [
            0.0 if bound is None else float(np.max(np.abs(value) / (bound[bends] if k == 2 else bound)))
            for k, (value, bound) in enumerate(zip(values, bounds, strict=True))
        ]
    )


def table_row(arm: Arm, dynamics: InverseDynamics, kind: str, jerk: float | None, count: int) -> None:
    """Measure many paths of one kind and print a row."""
    found = []
    failed = 0
    for seed in range(count):
        path = replace(make_path(KINDS[kind](np.random.default_rng([seed, arm.links]), arm.links)), spare=1e-4)
        try:
            found.append(measure(arm, dynamics, path, make_limits(arm, path, jerk)))
        except RetimingError as failure:
            print(f"- {kind}, seed {seed}: {failure.diagnosis.reason}")
            failed += 1
    cpu = 1e3 * np.array([item.seconds for item in found])
    worst = np.max([item.shares for item in found], axis=0)
    row(
        count,
        arm.links,
        kind,
        "none" if jerk is None else f"{jerk:g} rad/s³",
        *(f"{np.quantile(cpu, share):.1f}" for share in (0.5, 0.9, 1.0)),
        f"{np.median([item.duration for item in found]):.2f}",
        *(f"{value:.5f}" if value else "none" for value in worst),
        failed,
    )


def row(*cells: object) -> None:
    """Print a row of a table."""
    print(f"| {' | '.join(str(cell) for cell in cells)} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--paths", type=int, default=200)
    parser.add_argument("--links", type=int, nargs="+", default=[12])
    parser.add_argument("--kinds", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--jerk", type=float, nargs="*", default=[200.0], help="jerk limits [rad/s³]")
    options = parser.parse_args()
    row(*COLUMNS)
    row(*("---" for _ in COLUMNS))
    for links in options.links:
        arm = swan_neck(links)
        dynamics = InverseDynamics(arm, GRAVITY)
        first = make_path(smooth(np.random.default_rng(0), links))
        measure(arm, dynamics, first, make_limits(arm, first, None))
        for kind in options.kinds:
            for jerk in (None, *options.jerk):
                table_row(arm, dynamics, kind, jerk, options.paths)


if __name__ == "__main__":
    main()
