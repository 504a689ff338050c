"""Motions joined from leg to leg, and run backwards."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ccm_opt.core.arrays import ROUNDING
from ccm_opt.core.errors import Diagnosis, RetimingError
from ccm_opt.dynamics.retiming.timing_settings import DEFAULT_TIMING
from ccm_opt.problem.solution import JointTrajectory


def joined(
    trajectories: Sequence[JointTrajectory], pauses: Sequence[float] = (), *, step: float = DEFAULT_TIMING.sampling.step
) -> JointTrajectory:
    """Return one motion composed of several motions (legs), each from rest to rest, with pauses between them.

    Args:
        trajectories: the legs, at least one; each begins where the previous one ends.
        pauses: time at rest after each leg but the last, length ``len(trajectories) − 1`` [s]; by default none.
        step: largest time between two samples of a pause [s].

    Returns:
        The motion, whose ``stops`` are the stops of the legs and the samples at which legs end. The sample at a stop
        without a pause has the acceleration at the end of the leg.

    Raises:
        RetimingError: a leg does not begin where the previous one ends.
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
    """Return a motion reversed in time, for example a retraction.

    Velocities change their sign, accelerations do not.
    """
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
    """Return a motion extended by holding its last pose for a given time [s]."""
    count = int(np.ceil(pause / step - 1e-9))
    if count == 0:
        return trajectory
    time = np.linspace(0.0, pause, count + 1)[1:]
    at_rest = np.repeat(trajectory.positions[-1:], count, axis=0)
    rest = np.zeros_like(at_rest)
    return chained(trajectory, JointTrajectory(time, at_rest, rest, rest, trajectory.coordinates))


def _after(first: JointTrajectory, leg: JointTrajectory, stop: int) -> JointTrajectory:
    """Return two consecutive motions as one, with a stop between them at the sample with the index ``stop``.

    The second motion begins where the first one ends; its first sample, the same as that end, is left out.
    """
    later = tuple(len(first.time) - 1 + number for number in leg.stops)
    return replace(chained(first, leg.part(slice(1, None))), stops=(*first.stops, stop, *later))


def chained(first: JointTrajectory, second: JointTrajectory) -> JointTrajectory:
    """Return the samples of two consecutive motions as one; times of the second count from the end of the first."""
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
        # The rounding error of a position on a long axis grows with the position.
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
