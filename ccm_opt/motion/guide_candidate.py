"""A candidate of the search: a guide to try, and what takes over where it ends."""

from collections.abc import Callable
from dataclasses import dataclass

from ccm_opt.motion.continuation import Guide
from ccm_opt.motion.pose import Pose


@dataclass(frozen=True)
class GuideCandidate:
    """A guide to try.

    Attributes:
        name: for messages.
        make_guide: makes the guide to follow.
        resume: each makes a guide that takes over from the first guide and a pose: the first of them where that guide
            ended or stalled, each of the others where the one before has stalled.
    """

    name: str
    make_guide: Callable[[], Guide]
    resume: tuple[Callable[[Guide, Pose], Guide], ...] = ()
