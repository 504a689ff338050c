"""Whether the keyframes that are reported with a motion belong to it, and the curves that are reported with them."""

from collections.abc import Sequence

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.problem import CurvePose, Problem
from ccm_opt.solution import Check, JointTrajectory
from ccm_opt.verification.start_and_goal import on_curve
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings


def check_keyframes(
    trajectory: JointTrajectory, keyframes: FloatArray, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> Check:
    """Check that a motion passes its keyframes in order, and ends at the last of them.

    A cubic B-spline with the keyframes as control points passes an inner one at a sixth of its second difference, a
    third of the longer leg beside it; near the ends, where its knots are clamped, at a little more.

    Args:
        trajectory: the motion.
        keyframes: of all coordinates, shape (K, c) [rad, m].
        settings: of the verifier.
    """
    name = "keyframes against motion"
    if len(keyframes) == 0:
        return Check(name, np.inf, 0.0, "rad", "there are none", passed=False)
    legs = np.append(0.0, np.max(np.abs(np.diff(keyframes, axis=0)), axis=1, initial=0.0))
    allowed = settings.keyframe_share * np.maximum(legs, np.append(legs[1:], 0.0)) + settings.start_tolerance
    allowed[[0, -1]] = settings.start_tolerance
    # A motion that was given a new goal on its way has keyframes from the stop on alone.
    rests = (0, *trajectory.stops)
    sample = min(rests, key=lambda rest: float(np.max(np.abs(trajectory.positions[rest] - keyframes[0]))))
    worst = (0.0, 1.0, "")
    for number, (keyframe, most) in enumerate(zip(keyframes, allowed.tolist(), strict=True), start=1):
        last = number == len(keyframes)
        candidates = trajectory.positions[-1:] if last else trajectory.positions[sample:]
        away = np.max(np.abs(candidates - keyframe), axis=1)
        near = np.flatnonzero(away <= most)
        # The first sample that is near enough leaves the most samples to the keyframes that follow.
        sample += int(near[0]) if len(near) and not last else 0
        least = float(away[near[0]] if len(near) else np.min(away))
        worst = max(worst, (least, most, f"keyframe {number}"), key=lambda met: met[0] / met[1])
    return Check(name, worst[0], worst[1], "rad", worst[2], passed=worst[0] <= worst[1])


def check_nearest_curves(
    curves: Sequence[CurvePose], wanted: Sequence[CurvePose], settings: VerificationSettings
) -> Check:
    """Check that curves are those which come nearest to the keyframes.

    Args:
        curves: behind the keyframes, as they are reported.
        wanted: the same made from the keyframes.
        settings: of the verifier.

    Returns:
        The check; its worst value is a share of the greatest curvature, or of a radian.
    """
    name = "curves against keyframes"
    if [len(curve.configuration.segments) for curve in curves] != [
        len(curve.configuration.segments) for curve in wanted
    ]:
        return Check(name, np.inf, 0.0, "", f"{len(curves)} curves for {len(wanted)} keyframes", passed=False)
    steepest = max(float(np.max(np.abs(part.curvature))) for curve in wanted for part in curve.configuration.segments)
    # A straight curve has no size of its own; half a turn over the arm stands for it.
    size = max(steepest, np.pi / wanted[0].configuration.length)
    errors = [_difference(ours, theirs, size) for ours, theirs in zip(curves, wanted, strict=True)]
    k = int(np.argmax(errors))
    passed = errors[k] <= settings.curve_match
    return Check(name, errors[k], settings.curve_match, "", f"curve {k + 1}", passed=passed)


def check_followed_curves(
    problem: Problem, curves: Sequence[CurvePose], keyframes: FloatArray, settings: VerificationSettings
) -> Check:
    """Check that keyframes lie on their curves, where the curves were planned first; arguments as above."""
    name = "curves against keyframes"
    if len(curves) != len(keyframes):
        return Check(name, np.inf, 0.0, "m", f"{len(curves)} curves for {len(keyframes)} keyframes", passed=False)
    met = [
        check
        for curve, keyframe in zip(curves, keyframes, strict=True)
        for check in _on_curve(problem.arm, keyframe, curve, settings)
    ]
    k = int(np.argmax([check.worst / check.limit for check in met]))
    worst = met[k]
    where = f"{worst.where} of keyframe {k // 2 + 1}"
    return Check(name, worst.worst, worst.limit, "m", where, passed=all(check.passed for check in met))


def _on_curve(arm: Arm, keyframe: FloatArray, curve: CurvePose, settings: VerificationSettings) -> list[Check]:
    bends = keyframe[: arm.links]
    return on_curve("", arm, bends, curve, settings.curve_tip_tolerance, settings)


def _difference(pose: CurvePose, wanted: CurvePose, size: float) -> float:
    """The greatest difference of headings at the base [rad], and of curvatures, lengths and knots as shares."""
    ours = pose.configuration
    theirs = wanted.configuration
    found = [abs(ours.base_heading - theirs.base_heading)]
    for part, other in zip(ours.segments, theirs.segments, strict=True):
        found.append(float(np.max(np.abs(part.curvature - other.curvature))) / size)
        found.append(abs(part.length - other.length) / other.length)
        found.append(float(np.max(np.abs(np.subtract(part.knots, other.knots)))))
    return max(found)
