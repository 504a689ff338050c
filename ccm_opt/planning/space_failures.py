"""Why no motion was found: where every candidate ended, and what stood in the way of the best."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import short_length
from ccm_opt.errors import Diagnosis, MotionNotFound, TimeLimitReached
from ccm_opt.planning.space_pose import SpacePose
from ccm_opt.planning.space_step import SpaceStepper
from ccm_opt.planning.space_task import SpaceTask
from ccm_opt.scene.bad_pose import joints_at_limits


@dataclass(frozen=True)
class SpaceFailure:
    """Why one candidate failed.

    Attributes:
        candidate: its name.
        message: how far it came.
        remaining: distance of the tip from the goal where it ended [m].
        link: the link nearest to a wall there, counted from 1; 0 where nothing is near.
        owner: number of that wall in the scene's list of names; −1 where nothing is near.
        gap: between them [m].
        place: of the nearest point of the wall, shape (3,) [m].
        pose: configuration where it ended, shape (c,) [rad, m].
    """

    candidate: str
    message: str
    remaining: float
    link: int
    owner: int
    gap: float
    place: FloatArray
    pose: FloatArray

    @classmethod
    def at(
        cls,
        task: SpaceTask,
        candidate: str,
        message: str,
        stepper: SpaceStepper,
        pose: SpacePose,
        target: FloatArray | None,
    ) -> "SpaceFailure":
        """The failure of a candidate that ended in a pose; ``target`` is where the tip should be, or None."""
        first, _ = task.arm.mount_end
        near = task.tree.nearest(pose.segments_beyond(task.arm.mount_end), stepper.kept + 0.5 * task.arm.length)
        k = int(np.argmin(near.gap))
        remaining = 0.0 if target is None else float(np.linalg.norm(pose.tip - target))
        owner = int(near.owner[k])
        gap = float(near.gap[k]) - task.arm.radius
        named = "" if task.user is None else task.user.placed_at_goal().describe(pose.q)
        message = f"{message}; {named}" if named else message
        return cls(candidate, message, remaining, first + k + 1 if owner >= 0 else 0, owner, gap, near.point[k], pose.q)


def nothing_found(task: SpaceTask, failures: Sequence[SpaceFailure]) -> MotionNotFound | TimeLimitReached:
    """The error that says why no motion was found.

    Args:
        task: what was looked for.
        failures: of every candidate.
    """
    tried = sorted(failures, key=lambda failure: failure.remaining)
    held: tuple[str, ...] = ()
    if tried:
        best = tried[0]
        reason = (
            f"no motion found in {len(tried)} candidates; the best ({best.candidate}) ended with the tip "
            f"{short_length(best.remaining)} from the goal: {best.message}{_tightest(task, best)}"
        )
        bends = best.pose[: 2 * task.arm.links].reshape(-1, 2)
        joints, held = joints_at_limits(bends, task.arm.bend_limits)
        reason += f"; {joints}" if joints else ""
        reason += _constraints_elsewhere(task, tried)
    else:
        reason = "no motion found: there is no way through free space that the arm is thin enough for"
    figures = {
        "tried": [f"{each.candidate}: {each.message}{_tightest(task, each)}" for each in tried],
        "nearest_pose": tried[0].pose.tolist() if tried else [],
    }
    advice = [] if task.user is None else ["relax the constraints, or make them soft"]
    advice += held
    if tried and tried[0].owner >= 0:
        best = tried[0]
        near = f"link {best.link} was {short_length(best.gap)} from it where the best attempt ended"
        advice.append(f"make room at '{_wall_name(task, best)}': {near}")
    advice += ["use a smaller arm.radius"] if task.arm.radius > 0.0 else []
    if task.clearance > 0.0:
        advice.append("use a smaller workspace.clearance")
    if task.deadline.passed():
        reason = f"{task.deadline.what_passed()}: {reason}"
        return TimeLimitReached(Diagnosis(reason, "motion", (*advice, "raise planner.time_limit"), figures))
    advice += [] if held else ["raise arm.joint_limit_deg"]
    advice += ["use a longer arm", "add goal.via places on the way"]
    return MotionNotFound(Diagnosis(reason, "motion", tuple(advice), figures))


def _constraints_elsewhere(task: SpaceTask, tried: Sequence[SpaceFailure]) -> str:
    """Which of the user's constraints stood in the way of other candidates than the best, in words."""
    names = () if task.user is None else task.user.names
    counts = {name: sum(f"constraint '{name}'" in each.message for each in tried[1:]) for name in names}
    told = [name for name in names if counts[name] and f"'{name}'" not in tried[0].message]
    return "".join(f"; constraint '{name}' stood in the way of {counts[name]} of the others" for name in told)


def _tightest(task: SpaceTask, failure: SpaceFailure) -> str:
    """What a candidate nearly touched where it ended, in words."""
    if failure.owner < 0:
        return ""
    return f"; tightest there: link {failure.link}, {short_length(failure.gap)} from '{_wall_name(task, failure)}'"


def _wall_name(task: SpaceTask, failure: SpaceFailure) -> str:
    return task.names[failure.owner] if failure.owner < len(task.names) else "a wall"
