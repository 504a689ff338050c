"""Limits on how points of an arm in space move: speed and acceleration, at the samples and between them."""

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.drive_limits import Limits, PointLimit
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.space.verification.link_frames import LinkFrames, carried
from ccm_opt.space.verification.space_chain_motion import SpaceChainMotion
from ccm_opt.space.verification.space_newton_euler import LinkRates
from ccm_opt.verification.verification_settings import VerificationSettings


def check_space_points(
    motion: SpaceChainMotion, limits: Limits, trajectory: JointTrajectory, settings: VerificationSettings
) -> list[Check]:
    """Check every limit on a point of the arm.

    Speeds are judged by the reported velocities and by the distances from sample to sample, accelerations by the
    reported ones and by second differences of places: means that no motion through the samples can be below.
    """
    checks: list[Check] = []
    if not limits.points:
        return checks
    frames = LinkFrames.of(motion.arm, motion.positions)
    rates = LinkRates.of(motion.arm, frames, trajectory.velocities, trajectory.accelerations)
    for limit in limits.points:
        if np.isfinite(limit.velocity):
            speeds = [_reported_speeds(motion, limit, frames, rates, trajectory), _speeds_between(motion, limit)]
            checks.append(_check(f"{limit.name} velocity", limit.velocity, "m/s", speeds, trajectory.time, settings))
        if np.isfinite(limit.acceleration):
            gains = [_reported_gains(motion, limit, rates, trajectory), _second_differences(motion, limit)]
            bound = limit.acceleration
            checks.append(_check(f"{limit.name} acceleration", bound, "m/s²", gains, trajectory.time, settings))
    return checks


def _levers(motion: SpaceChainMotion, limit: PointLimit) -> FloatArray:
    """Length of every link before the point, shape (links,) [m]."""
    arm = motion.arm
    at = arm.length if limit.at is None else limit.at
    return np.asarray(np.clip(at - arm.link_length * np.arange(arm.links), 0.0, arm.link_length))


def _between_joints(motion: SpaceChainMotion, limit: PointLimit, of_joints: FloatArray) -> FloatArray:
    """What is true of a point where it is linear along a link, from that of the joints, shape (T, …)."""
    arm = motion.arm
    at = arm.length if limit.at is None else limit.at
    link = min(int(at / arm.link_length), arm.links - 1)
    share = min(at / arm.link_length - link, 1.0)
    return np.asarray((1.0 - share) * of_joints[:, link] + share * of_joints[:, link + 1])


def _reported_speeds(
    motion: SpaceChainMotion, limit: PointLimit, frames: LinkFrames, rates: LinkRates, trajectory: JointTrajectory
) -> FloatArray:
    base = carried(motion.arm, trajectory.velocities)[:, None] * motion.arm.direction
    swing = np.cross(rates.rate, frames.along)
    return np.asarray(np.linalg.norm(base + np.einsum("k,tkd->td", _levers(motion, limit), swing), axis=1))


def _speeds_between(motion: SpaceChainMotion, limit: PointLimit) -> FloatArray:
    """The mean speed of every step, which the speed at some time of it is not below, shape (T − 1,) [m/s]."""
    places = _between_joints(motion, limit, motion.points)
    step = np.diff(motion.time)
    noise = 2.0 * motion.rounding / step
    return np.asarray(np.maximum(np.linalg.norm(np.diff(places, axis=0), axis=1) / step - noise, 0.0))


def _reported_gains(
    motion: SpaceChainMotion, limit: PointLimit, rates: LinkRates, trajectory: JointTrajectory
) -> FloatArray:
    base = carried(motion.arm, trajectory.accelerations)[:, None] * motion.arm.direction
    joints = np.concatenate((base[:, None], rates.ends), axis=1)
    return np.asarray(np.linalg.norm(_between_joints(motion, limit, joints), axis=1))


def _second_differences(motion: SpaceChainMotion, limit: PointLimit) -> FloatArray:
    """Means of the acceleration about the inner samples, shape (T − 2,) [m/s²]."""
    places = _between_joints(motion, limit, motion.points)
    step = np.diff(motion.time)
    mean = np.diff(places, axis=0) / step[:, None]
    gains = np.linalg.norm(np.diff(mean, axis=0), axis=1) / (0.5 * (step[1:] + step[:-1]))
    noise = 8.0 * motion.rounding / np.minimum(step[1:], step[:-1]) ** 2
    return np.asarray(np.maximum(gains - noise, 0.0))


def _check(
    name: str,
    limit: float,
    unit: str,
    sources: list[FloatArray],
    time: FloatArray,
    settings: VerificationSettings,
) -> Check:
    """The greatest value of any source against the limit."""
    worst = max(float(np.max(values, initial=0.0)) for values in sources)
    source = next(values for values in sources if np.max(values, initial=0.0) == worst)
    at = int(np.argmax(source)) if len(source) else 0
    where = f"t = {time[at]:.4f} s"
    return Check(name, worst, limit, unit, where, passed=worst <= limit * (1.0 + settings.limit_tolerance))
