"""The user's hard constraints while a motion in space is planned, with the costs that go with them.

A gap is divided by the norm of its slope by the configuration, in which a feed counts by the arm's length: so it is
the turn of the whole arm that closes it, and one margin suits gaps in metres, radians or any other unit. Steps keep a
share of the margin; edges between them are sampled. Equations are rows that a step has to meet; after it Newton's
method brings the unknowns back onto them.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray
from ccm_opt.planning.pose import Term
from ccm_opt.planning.settings import UserLimitSettings
from ccm_opt.planning.space_pose import SpacePose

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms
    from ccm_opt.ik.row_set import RowSet, RowValues
    from ccm_opt.robot.space_arm import SpaceArm

_FAR = 1e30


@dataclass(frozen=True, eq=False)
class UserStepRows:
    """Rows of a step: an equation where both bounds are the same.

    Attributes:
        rows: by the unknowns, shape (m, p).
        lower: what they have to gain at least, shape (m,).
        upper: and at most, shape (m,).
        pull: what opens gaps inside their margin.
    """

    rows: FloatArray
    lower: FloatArray
    upper: FloatArray
    pull: Term


@dataclass(frozen=True, eq=False)
class SpaceUserLimit:
    """All constraints and costs of one problem in space.

    Attributes:
        arm: the arm.
        terms: constraints and costs, compiled.
        motion_rows: rows at keyframes on the way; those of an interval hold a little before and behind it too, so that
            a path which is smooth there keeps them on all of it.
        breaks: path parameters inside (0, 1) at which these begin or end, increasing.
        settings: numbers, those of the plane.
        u: path parameter at which the constraints are looked at.
        at_goal: whether those at the goal are meant, not those on the way.
    """

    arm: "SpaceArm"
    terms: "UserTerms"
    motion_rows: "RowSet"
    breaks: FloatArray
    settings: UserLimitSettings = field(default_factory=UserLimitSettings)
    u: float = 0.0
    at_goal: bool = False

    @classmethod
    def of(cls, arm: "SpaceArm", terms: "UserTerms", lead: float) -> "SpaceUserLimit":
        """The limit of some terms.

        Args:
            arm: the arm.
            terms: constraints and costs, compiled.
            lead: by how much of the motion intervals are widened at most; where one ends shortly before another
                begins, they stay apart.
        """
        exact = terms.motion_rows
        places = np.unique(np.concatenate(([0.0, 1.0], terms.breaks)))
        lead = min(lead, float(np.min(np.diff(places))) / 3.0)
        first = np.where(exact.first > 0.0, exact.first - lead, 0.0)
        last = np.where(exact.last < 1.0, exact.last + lead, 1.0)
        inside = np.unique(np.concatenate((first, last, terms.breaks)))
        breaks = inside[(inside > 0.0) & (inside < 1.0)]
        return cls(arm, terms, replace(exact, first=first, last=last), breaks)

    @property
    def rows(self) -> "RowSet":
        """Rows of the constraints, on the way or at the goal."""
        return self.terms.goal_rows if self.at_goal else self.motion_rows

    @property
    def shapes_path(self) -> bool:
        """Whether a path beside the keyframes may miss equations that these meet."""
        return bool(self.terms.path_rows.equal.any())

    def placed(self, u: float) -> "SpaceUserLimit":
        """The constraints at another place of the motion."""
        return replace(self, u=u)

    def placed_at_goal(self) -> "SpaceUserLimit":
        """The constraints at the goal."""
        return replace(self, u=1.0, at_goal=True)

    def values(self, q: FloatArray) -> "RowValues":
        """Rows at a configuration, shape (c,) [rad, m]."""
        return self.rows.at(q, self.u)

    def turns(self, slopes: FloatArray) -> FloatArray:
        """By how much a turn of the whole arm changes each row of slopes, shapes (m,) and (m, c); never 0."""
        return np.asarray(np.maximum(np.linalg.norm(slopes * self._units, axis=1), TINY))

    @cached_property
    def _units(self) -> FloatArray:
        """What counts as a radian of each coordinate, shape (c,) [rad, m]."""
        return np.append(np.ones(2 * self.arm.links), np.full(len(self.arm.base_axes), self.arm.length))

    # ------------------------------------------------------------ a step
    def linearised(self, pose: SpacePose, turn: float) -> UserStepRows:
        """Rows about a pose: equations, met at once or as far as a turn allows [rad], and gaps that are not far."""
        settings = self.settings
        now = self.values(pose.q)
        equations, target = self._independent(pose, now, turn)
        scale = self.turns(now.gap_slopes)
        # Negated, so that a gap that is NaN keeps its row and is refused, instead of passing unseen.
        near = ~(now.gaps > settings.far * scale)
        scale = scale[near]
        gaps = now.gaps[near] / scale
        rows = now.gap_slopes[near] @ pose.slopes / scale[:, None]
        # Never above 0: standing still stays feasible even inside the margin, where the pull asks for room instead.
        lower = np.minimum(-0.5 * (gaps - settings.margin), 0.0)
        return UserStepRows(
            np.vstack((equations, rows)),
            np.concatenate((target, lower)),
            np.concatenate((target, np.full(len(rows), _FAR))),
            self._pull(rows, gaps, turn),
        )

    def _pull(self, rows: FloatArray, gaps: FloatArray, turn: float) -> Term:
        """Ask gaps inside their margin to open, broken ones urgently."""
        margin = self.settings.margin
        near = gaps < margin
        short = margin - gaps[near]
        broken = gaps[near] < 0.0
        urgency = np.where(broken, self.settings.urgency, 1.0)
        # Half of a shortfall at a time moves the arm gently; a broken gap has to be opened at once.
        wanted = np.where(broken, short, 0.5 * short)
        return Term(urgency[:, None] * rows[near], urgency * np.minimum(wanted, turn), self.settings.pull_weight)

    def _independent(self, pose: SpacePose, now: "RowValues", turn: float) -> tuple[FloatArray, FloatArray]:
        """Orthonormal combinations of the equations' rows, and what they have to change by."""
        slopes = now.equation_slopes @ pose.slopes
        if not len(slopes):
            return slopes, now.equations
        # Dependent rows would make the program degenerate: only directions whose singular value counts are kept.
        left, sizes, right = np.linalg.svd(slopes, full_matrices=False)
        kept = sizes > self.settings.rank * max(float(sizes[0]), TINY)
        target = -(left.T @ now.equations)[kept] / sizes[kept]
        most = float(np.max(np.linalg.norm(pose.chain.turning @ (right[kept].T @ target), axis=1)))
        return right[kept], target * min(1.0, 0.5 * turn / max(most, TINY))

    def keeps(self, before: FloatArray, after: FloatArray) -> bool:
        """Whether a step between two configurations leaves every gap its share of the margin, or what it had."""
        settings = self.settings
        start = self.values(before)
        end = self.values(after)
        floor = np.minimum(settings.keep_share * settings.margin * self.turns(start.gap_slopes), start.gaps)
        if not np.isfinite(end.violation) or not np.all(end.gaps >= floor - TINY):
            return False
        # Far from the equations the sum decides: one of them may grow for a step while the others shrink.
        met = np.max(np.abs(end.equations), initial=0.0) <= settings.met_at_goal
        return bool(met or np.abs(end.equations).sum() < np.abs(start.equations).sum())

    # ------------------------------------------------------------ what is missed
    def miss(self, q: FloatArray) -> float:
        """By how much the worst row is missed, beyond what counts as met."""
        miss = self.values(q).violation
        return 0.0 if miss <= self.settings.met_at_goal else miss

    def missed(self, pose: SpacePose) -> tuple[FloatArray, FloatArray]:
        """Rows of the equations and of broken gaps, shape (k, p), and by what they have to change, as turns [rad]."""
        now = self.values(pose.q)
        broken = now.gaps < 0.0
        slopes = np.vstack((now.equation_slopes, now.gap_slopes[broken]))
        scale = self.turns(slopes)
        # Aimed a little beyond 0, else rounding would leave the gap broken and Newton would go on in vain.
        aim = self.settings.keep_share * self.settings.margin
        change = np.append(-now.equations, -now.gaps[broken]) / scale
        change[len(now.equations) :] += aim
        return slopes @ pose.slopes / scale[:, None], change

    def mending(self, pose: SpacePose, most: float) -> Term:
        """What draws a pose onto equations and out of narrow gaps, by at most a turn [rad] at a time."""
        now = self.values(pose.q)
        margin = self.settings.margin
        scale = self.turns(now.gap_slopes)
        short = now.gaps < margin * scale
        slopes = np.vstack((now.equation_slopes, now.gap_slopes[short]))
        wanted = np.append(-now.equations, margin * scale[short] - now.gaps[short])
        scale = self.turns(slopes)
        rows = slopes @ pose.slopes / scale[:, None]
        return Term(rows, np.clip(wanted / scale, -most, most), self.settings.pull_weight)

    # ------------------------------------------------------------ between keyframes
    @cached_property
    def _lasting(self) -> BoolArray:
        """Which rows are gaps that hold over the whole motion, wherever keyframes are on it."""
        rows = self.terms.path_rows
        return np.asarray(~rows.equal & (rows.first <= 0.0) & (rows.last >= 1.0) & ~rows.parametric)

    def holds_between(self, before: FloatArray, after: FloatArray) -> bool:
        """Whether gaps are kept at samples of an edge that is linear between two configurations, shape (c,).

        Where both ends have a reserve, for what lies between samples, all samples have.
        """
        if not self._lasting.any():
            return True
        share = np.linspace(0.0, 1.0, 2 * self.settings.samples + 1)[:, None]
        gaps = self.terms.path_rows.table(before + share * (after - before))[:, self._lasting]
        ends = np.minimum(gaps[0], gaps[-1])
        floor = np.where(ends >= self._reserve(before), self._reserve(before), -self._slack)
        # Negated, so that NaN counts as short.
        return not np.any(~(gaps >= floor))

    def _reserve(self, q: FloatArray) -> FloatArray:
        """What gaps keep between keyframes near a configuration, in the user's units, shape (rows that last,)."""
        settings = self.settings
        slopes = np.asarray(self.terms.path_rows.slopes(q, 0.0)[1])[self._lasting]
        return settings.reserve * settings.keep_share * settings.margin * self.turns(slopes)

    @property
    def _slack(self) -> float:
        return self.settings.path_share * self.settings.allowed

    def missed_on_path(self, q: FloatArray, u: FloatArray) -> BoolArray:
        """At which samples of a path, shape (N, c) at u (N,), a row is missed by more than its share of what may be."""
        rows = self.terms.path_rows
        table = rows.table(q, u)
        miss = np.where(rows.equal, np.abs(table), -table)
        return np.asarray(np.any(miss > self._slack, axis=1))

    # ------------------------------------------------------------ words
    @property
    def names(self) -> tuple[str, ...]:
        """Names of the hard constraints."""
        return tuple(hard.constraint.name for hard in self.terms.hard)

    def describe(self, q: FloatArray) -> str:
        """The constraint that is missed most, or else one at its bound, in words; empty when there is none."""
        rows = self.rows
        values, slopes = (np.asarray(each) for each in rows.slopes(q, self.u))
        values = values[:, 0]
        here = (rows.first <= self.u) & (self.u <= rows.last)
        scale = self.turns(slopes)
        miss = np.where(here, np.where(rows.equal, np.abs(values), np.maximum(-values, 0.0)), 0.0)
        if not len(miss):
            return ""
        worst = int(np.argmax(miss / scale))
        if miss[worst] > self.settings.met_at_goal:
            return f"constraint '{rows.names[worst]}' is missed by {miss[worst]:.3g}"
        near = here & ~rows.equal & (values < 2.0 * self.settings.margin * scale)
        return f"constraint '{rows.names[int(np.flatnonzero(near)[0])]}' is at its bound" if near.any() else ""
