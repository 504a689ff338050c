"""Retiming: the fastest motion along a joint path within its limits (TOPP-RA), or Paul's transitions."""

from collections.abc import Iterator
from functools import partial

from ccm_opt.dynamics.retiming.timed_path import InverseDynamics, Revolutes
from ccm_opt.dynamics.retiming.timing import joined, retime, reversed_trajectory
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING, TimingSettings
from ccm_opt.problem import Limits, RetimingName
from ccm_opt.problem.solution import JointPath, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.coordinates import Coordinates

__all__ = ["joined", "retime", "reversed_trajectory", "timings"]


def timings(
    path: JointPath,
    limits: Limits,
    inverse_dynamics: InverseDynamics,
    *,
    revolutes: Revolutes,
    method: RetimingName = "toppra",
    link_length: float | None = None,
    coordinates: Coordinates | None = None,
    arm: Arm | None = None,
    share: float = 1.0,
    settings: TimingSettings = DEFAULT_TIMING,
) -> Iterator[JointTrajectory]:
    """Yield the timed motions along a path, the most wanted first.

    The first that the verifier accepts is the one to take.

    TOPP-RA stays on the path, so there is one; Paul's transitions leave it, by less from motion to motion.

    Args:
        path: the path and its keyframes.
        limits: of every revolute, of the feed axis, and of points of the arm.
        inverse_dynamics: angles, velocities, accelerations to torques, as ``retime`` takes it.
        revolutes: bends to revolute angles.
        method: how to time.
        coordinates: what the columns of the path are; when None, a bend a link, and a feed axis if one is left over.
        link_length: of the arm [m], by which TOPP-RA's samples are so close that chords between them stay by the path.
        arm: whose points are limited; needed when the limits name some.
        share: of the limits of the drives that may be used, see ``robot.coordinates``; points of the arm may use
            theirs in full.
        settings: numbers of timing along the path.

    Raises:
        RetimingError: from the first motion, or a later one, that cannot be timed within the limits.
    """
    if method == "toppra":
        yield retime(
            path,
            limits,
            inverse_dynamics,
            revolutes=revolutes,
            link_length=link_length,
            coordinates=coordinates,
            arm=arm,
            share=share,
            settings=settings,
        )
        return

    from ccm_opt.dynamics.retiming.paul import WINDOWS, retime_paul  # noqa: PLC0415 - most motions are timed by TOPP-RA

    turn = partial(
        retime_paul,
        path,
        limits,
        inverse_dynamics,
        revolutes=revolutes,
        coordinates=coordinates,
        arm=arm,
        share=share,
    )
    # From wide transitions, which are fast, to narrow ones, which stay nearer to the polygon.
    for window in WINDOWS:
        yield turn(window=window)
