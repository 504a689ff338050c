"""What the search for a motion is given, and what it finds."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.collision.certificate import Certificate, allowed_contact
from ccm_opt.collision.contacts import ContactFinder
from ccm_opt.collision.walls import Walls
from ccm_opt.freespace.workspace import Workspace
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.constrained.certificate import OwnCertificate
from ccm_opt.motion.constrained.rows import OwnRows
from ccm_opt.motion.continuation import Deadline
from ccm_opt.motion.goal import GoalPose
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.motion_settings import MotionSettings
from ccm_opt.motion.tip_paths import TipPath
from ccm_opt.problem import OptimiserName, Weights

if TYPE_CHECKING:
    from ccm_opt.user_terms.compiled_terms import UserTerms

SPARE = 1e-4
"""Gap beyond contact that the certificate asks for, as a share of the arm's length."""


@dataclass(frozen=True)
class Slowness:
    """What joints can do less than the average joint, as factors.

    Attributes:
        speed: mean of all speed limits over a joint's own, shape (links,).
        acceleration: the same of the acceleration limits, shape (links,).
    """

    speed: FloatArray
    acceleration: FloatArray

    @classmethod
    def of(cls, speeds: FloatArray, accelerations: FloatArray) -> "Slowness":
        """From the limits of the joints, each of shape (links,)."""
        return cls(speeds.mean() / speeds, accelerations.mean() / accelerations)

    def resampled(self, links: int) -> "Slowness":
        """The same along an arm with another number of links."""
        middles, wanted = ((np.arange(count) + 0.5) / count for count in (len(self.speed), links))
        return Slowness(np.interp(wanted, middles, self.speed), np.interp(wanted, middles, self.acceleration))


@dataclass(frozen=True)
class MotionTask:
    """What the search needs to know.

    Attributes:
        arm: the arm.
        workspace: the room.
        start: link headings at the start, shape (links,) [rad].
        goal: where the tip has to be.
        goal_headings: of a whole-arm goal, shape (links,) [rad], or None.
        guesses: link headings of possible goal poses to interpolate to, each of shape (links,) [rad]; made when first
            asked for.
        tip_paths: classes of tip motions, most promising first.
        deadline: when to stop.
        clamped: whether the first link must keep its heading.
        further_guesses: makes more such poses, when the first do not help.
        optimiser: how the motion that is found is optimised.
        seed: of all chance.
        weights: what counts how much when the motion is optimised.
        slowness: of the joints; None when all are alike.
        terms: the user's own constraints and costs, or None.
        settings: numbers of every stage of the search.
    """

    arm: Arm
    workspace: Workspace
    start: FloatArray
    goal: GoalPose
    goal_headings: FloatArray | None
    guesses: Iterable[FloatArray]
    tip_paths: tuple[TipPath, ...]
    deadline: Deadline
    clamped: bool = False
    further_guesses: Callable[[], Iterator[FloatArray]] = field(default=lambda: iter(()))
    optimiser: OptimiserName = "sequential-convex"
    seed: int = 0
    weights: Weights = field(default_factory=Weights)
    slowness: Slowness | None = None
    terms: "UserTerms | None" = None
    settings: MotionSettings = field(default_factory=MotionSettings)

    @cached_property
    def certificate(self) -> Certificate:
        """The certificate that motions must pass: a little more than contact, but no more than both ends have.

        Ends that touch may be left, and reached, by motions that touch no deeper than rounding.
        """
        ends = [self.start] if self.goal_headings is None else [self.start, self.goal_headings]
        finder = ContactFinder(
            self.arm, Walls.of(self.workspace), self.workspace.clearance, 0.0, 4.0 * SPARE * self.arm.length
        )
        gaps = [finder.find(self.arm.joint_positions(end)).gap.min(initial=np.inf) for end in ends]
        contact = allowed_contact(self.arm, self.workspace)
        spare = np.clip(0.5 * min(gaps) - contact, -contact, SPARE * self.arm.length)
        certificate = Certificate(self.arm, self.workspace, float(spare))
        return certificate if self.terms is None else OwnCertificate.around(certificate, self.terms.path_rows)

    def own_rows(self, space: LinkSpace) -> OwnRows | None:
        """Rows of the user's constraints on the way, in a link space; None when there are none."""
        return None if self.terms is None else OwnRows(space, self.terms.motion_rows)

    def goal_in(self, space: LinkSpace) -> GoalPose:
        """The goal with the user's constraints there, in a link space."""
        own = None if self.terms is None else OwnRows(space, self.terms.goal_rows, 1.0)
        return replace(self.goal, own=own)


class Remembered:
    """Items that are costly to make: each is made when first asked for, and kept.

    Args:
        items: makes them.
    """

    def __init__(self, items: Iterable[FloatArray]) -> None:
        self._items, self._known = iter(items), list[FloatArray]()

    def __iter__(self) -> Iterator[FloatArray]:
        """All items from the first."""
        return self()

    def __call__(self) -> Iterator[FloatArray]:
        """All items from the first."""
        for k in count():
            if k == len(self._known):
                item = next(self._items, None)
                if item is None:
                    return
                self._known.append(item)
            yield self._known[k]


@dataclass(frozen=True)
class Motion:
    """A certified piecewise-linear motion on the links.

    Attributes:
        space: the link space it was planned in.
        coordinates: at the keyframes, shape (K, p).
        headings: link headings at the keyframes, shape (K, links) [rad].
        candidate: name of the candidate that led to it.
        u: path parameter at the keyframes, shape (K,), or None where nothing depends on it.
    """

    space: LinkSpace
    coordinates: FloatArray
    headings: FloatArray
    candidate: str
    u: FloatArray | None = None


def coarsened(task: MotionTask, links: int) -> MotionTask:
    """The same task for an arm of the same length with fewer links."""
    many = task.arm.links
    arm = replace(
        task.arm,
        links=links,
        link_length=task.arm.length / links,
        masses=np.full(links, task.arm.masses.mean()),
        inertia_axial=np.full(links, task.arm.inertia_axial.mean()),
        inertia_transverse=np.full(links, task.arm.inertia_transverse.mean()),
    )

    def resampled(headings: FloatArray) -> FloatArray:
        covered = np.concatenate(([0.0], np.cumsum(headings)))
        edges = np.interp(np.linspace(0.0, many, links + 1), np.arange(many + 1), covered)
        return np.diff(edges) * links / many

    return replace(
        task,
        arm=arm,
        start=resampled(task.start),
        goal_headings=None if task.goal_headings is None else resampled(task.goal_headings),
        guesses=Remembered(resampled(guess) for guess in task.guesses),
        further_guesses=lambda: (resampled(guess) for guess in task.further_guesses()),
        slowness=None if task.slowness is None else task.slowness.resampled(links),
    )
