"""Motions put together in time: legs with pauses between them, and a motion backward."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccm_opt.errors import Diagnosis, RetimingError
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.retiming.timing_settings import DEFAULT_TIMING
from ccm_opt.solution import JointTrajectory


def joined(
    trajectories: Sequence[JointTrajectory], pauses: Sequence[float] = (), *, step: float = DEFAULT_TIMING.sampling.step
) -> JointTrajectory:
    """One motion along several legs, each from rest to rest, with pauses between them.

    Args:
        trajectories: at least one; each begins where the one before ends.
        pauses: time at rest after each leg but the last, length ``len(trajectories) − 1`` [s]; none when left out.
        step: largest time between two samples of a pause [s].

    Returns:
        Its ``stops`` are the samples at which the legs end, beside those that the legs have themselves. The sample at
        a stop without a pause reports the acceleration at the end of the leg.

    Raises:
        RetimingError: a leg does not begin where the one before ends.
        ValueError: the pauses do not fit the legs.
    """
    pauses = pauses or [0.0] * (len(trajectories) - 1)
    if len(pauses) != len(trajectories) - 1 or min(pauses, default=0.0) < 0.0:
        raise ValueError(f"got pauses {list(pauses)} for {len(trajectories)} legs; expected one, ≥ 0, between two legs")
    whole = trajectories[0]
    for number, (leg, pause) in enumerate(zip(trajectories[1:], pauses, strict=True), start=1):
        _check_place(whole, leg, number)
        whole = _after(_paused(whole, pause, step), leg, stop=len(whole.time) - 1)
    return whole


def reversed_trajectory(trajectory: JointTrajectory) -> JointTrajectory:
    """The same motion backward: velocities change their sign, accelerations do not; a retraction."""
    last = len(trajectory.time) - 1
    return replace(
        trajectory,
        time=trajectory.time[-1] - trajectory.time[::-1],
        positions=trajectory.positions[::-1].copy(),
        velocities=0.0 - trajectory.velocities[::-1],  # not -v: what rests keeps +0.0
        accelerations=trajectory.accelerations[::-1].copy(),
        stops=tuple(last - stop for stop in reversed(trajectory.stops)),
    )


def _paused(trajectory: JointTrajectory, pause: float, step: float) -> JointTrajectory:
    """The motion with its last pose held for some time."""
    count = int(np.ceil(pause / step - 1e-9))
    if count == 0:
        return trajectory
    time = np.linspace(0.0, pause, count + 1)[1:]
    held = np.repeat(trajectory.positions[-1:], count, axis=0)
    rest = np.zeros_like(held)
    return _chained(trajectory, JointTrajectory(time, held, rest, rest, trajectory.coordinates))


def _after(first: JointTrajectory, leg: JointTrajectory, stop: int) -> JointTrajectory:
    """Two motions in a row; the first sample of the second is the last of the first."""
    later = tuple(len(first.time) - 1 + number for number in leg.stops)
    return replace(_chained(first, leg.part(slice(1, None))), stops=(*first.stops, stop, *later))


def _chained(first: JointTrajectory, second: JointTrajectory) -> JointTrajectory:
    """The samples of both, the time of the second counted from the end of the first."""
    return replace(
        first,
        time=np.concatenate((first.time, first.time[-1] + second.time)),
        positions=np.concatenate((first.positions, second.positions)),
        velocities=np.concatenate((first.velocities, second.velocities)),
        accelerations=np.concatenate((first.accelerations, second.accelerations)),
        timed_by=(*first.timed_by, *second.timed_by),
    )


def _check_place(first: JointTrajectory, leg: JointTrajectory, number: int) -> None:
    # Legs in different coordinates do not fit at all, whatever their numbers.
    gap = np.inf
    if first.coordinates == leg.coordinates:
        # Rounding of a place on a long axis grows with the place.
        size = np.maximum(np.abs(first.positions[-1]), 1.0)
        gap = float(np.max(np.abs(leg.positions[0] - first.positions[-1]) / size))
    if gap <= ROUNDING:
        return
    raise RetimingError(
        Diagnosis(
            reason=f"leg {number + 1} begins {gap:.3g} (rad or m) away from where leg {number} ends",
            stage="retiming",
            advice=("plan each leg from the end of the one before",),
            evidence={"leg": number + 1, "gap": gap},
        )
    )
