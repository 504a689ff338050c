"""A planner that records its paths: limits of torque and masses of links change no path, so none is planned twice."""

from dataclasses import dataclass, field

from ccm_opt.planners.protocols import Planner
from ccm_opt.problem import Problem
from ccm_opt.solution import JointPath


@dataclass(frozen=True)
class RecordingPlanner:
    """A planner that hands out a recorded path again; satisfies the ``Planner`` protocol.

    Attributes:
        planner: plans what is not recorded.
        paths: recorded so far, each with the problem that it was found for.
    """

    planner: Planner
    paths: list[tuple[Problem, JointPath]] = field(default_factory=list)

    def plan(self, problem: Problem) -> JointPath:
        """The path of a problem; the recorded one when nothing that decides it has changed.

        Raises:
            NoPlanFound: with the reason and what would help.
        """
        for known, path in self.paths:
            if _same_geometry(known, problem):
                return path
        path = self.planner.plan(problem)
        self.paths.append((problem, path))
        return path


def _same_geometry(one: Problem, other: Problem) -> bool:
    """Whether all that decides a path is the same; parts that ``replace`` has left alone are the very same objects."""
    numbers = ("links", "link_length", "radius", "base_heading", "joint_limit", "base_limit", "mount_length", "feed")
    parts = ("workspace", "start", "goal", "stops")
    return (
        all(getattr(one.arm, name) == getattr(other.arm, name) for name in (*numbers, "self_collision"))
        and one.arm.base is other.arm.base
        and one.tolerances == other.tolerances
        and all(getattr(one, name) is getattr(other, name) for name in parts)
    )
