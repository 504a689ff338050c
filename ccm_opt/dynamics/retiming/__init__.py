"""Timing of joint paths: the fastest motion along a path within limits (TOPP-RA), or Paul's transitions."""

from collections.abc import Iterator
from functools import partial

from ccm_opt.core.arrays import FloatArray
from ccm_opt.dynamics.retiming.joined_motions import joined, reversed_trajectory
from ccm_opt.dynamics.retiming.timed_path import InverseDynamics, Revolutes
from ccm_opt.dynamics.retiming.timing import retime
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
    link_lengths: FloatArray | None = None,
    coordinates: Coordinates | None = None,
    arm: Arm | None = None,
    share: float = 1.0,
    settings: TimingSettings = DEFAULT_TIMING,
) -> Iterator[JointTrajectory]:
    """Yield timed motions along a path in order of preference; the first that the verifier accepts should be used.

    TOPP-RA stays on the path and yields one motion. Paul's transitions leave the path; each yielded motion does so by
    less than the previous one.

    Args:
        path: the path and its keyframes.
        limits: limits of every revolute joint, of the feed axis, and of points of the arm.
        inverse_dynamics: map from angles, velocities and accelerations to torques, as for ``retime``.
        revolutes: map from bends to revolute angles.
        method: "toppra" for TOPP-RA, or "paul" for Paul's transitions.
        coordinates: the columns of the path; if None, one bend per link, and a feed axis if there is one more column.
        link_lengths: length of each link, shape (links,) [m], for which TOPP-RA samples densely enough that chords stay
            near the path.
        arm: the arm whose points are limited; needed only if the limits name points.
        share: fraction of the drives' limits that may be used, see ``robot.coordinates``; points of the arm may use
            their limits in full.
        settings: settings of the timing.

    Raises:
        RetimingError: a motion cannot be timed within the limits.
    """
    if method == "toppra":
        yield retime(
            path,
            limits,
            inverse_dynamics,
            revolutes=revolutes,
            link_lengths=link_lengths,
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
    # Wide transitions, which are fast, come first; narrow ones stay nearer to the polygon.
    for window in WINDOWS:
        yield turn(window=window)
