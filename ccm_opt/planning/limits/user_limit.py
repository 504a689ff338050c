"""User's hard constraints and costs as a limit on the motion.

A constraint gives equations h(q, u) = 0 and inequalities g(q, u) ≥ 0, whose values g are called gaps. Gaps keep a
margin where possible, as clearances do. Equations are constraints that a QP step has to meet to first order; afterwards
Newton's method brings the unknowns back onto the equations.

A gap is divided by the norm of its derivative with respect to the headings of the links, in which the travel of the
base counts per length of the arm. The quotient is the least rotation of the links (root of the sum of squares, to first
order) that closes the gap [rad], so one margin suits gaps in metres, radians or any other unit, in the plane and in
space.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.core.arrays import TINY, BoolArray, FloatArray, IntArray
from ccm_opt.planning.limits.limit import UNBOUNDED, KeyframeRows, LimitOf, LimitRows, MotionCost
from ccm_opt.planning.limits.limit_stack import overbent
from ccm_opt.planning.limits.user_motion_rows import UserCosts, refuse_broken_goal, refuse_broken_start, slope_norms
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term, least_change

if TYPE_CHECKING:
    from ccm_opt.ik.compiled_terms import UserTerms
    from ccm_opt.ik.row_set import RowSet, RowValues
    from ccm_opt.planning.optimisation.interval_rows import Sweep

_PATH_SHARE = 0.2
"""Fraction of the allowed violation by which the smooth path may violate a constraint between its knots. Heuristic."""
_PULL_WEIGHT = 30.0
"""Weight of terms that restore gaps smaller than their margin, relative to a displacement of a nominal link. Heuristic;
the weight for contacts is the same."""
_URGENCY = 10.0
"""Factor on the terms that open violated gaps, relative to those for gaps merely inside their margin. Heuristic."""
_RANK = 1e-09
"""Fraction of the largest singular value below which a singular value counts as zero, so that equations that follow
from others are left out. Heuristic."""
_RESERVE = 0.02
"""Fraction of the kept margin that a gap keeps between keyframes, as a reserve for configurations between samples.
Heuristic."""
_SAMPLES = 4
"""Number of samples of an interval between keyframes. Heuristic."""

_JOINT_SHARE = 0.995
"""Fraction of a joint limit to which excessive bends are brought back, so that the overshoot of splines stays below the
limit. Heuristic."""

_KNOT_RESERVES = 4.0
"""Size to which a gap is opened at a knot of the smooth path if it is less than half of that, as a multiple of the
reserve between keyframes. Measured:
with 2 a path at the edge of a camera's view was refused, with 4 it was accepted."""
_MARGIN = 2e-3
"""Margin of a gap, as the least rotation of the links that closes it [rad]. Heuristic: a tenth of a degree."""
_KEEP_SHARE = 0.4
"""Fraction of the margin that every accepted pose keeps. Heuristic; the fraction for contacts is the same."""
_MET_AT_GOAL = 1e-8
"""Largest violation of constraints at the goal and at keyframes, in the user's unit. Derived: two orders below what the
verifier allows."""
_MET = 1e-10
"""Largest residual with which equations count as met, in the user's unit. Derived: four orders below what the verifier
allows."""
_ALLOWED = 1e-6
"""Largest violation of a hard constraint, in the user's unit. Derived: what the verifier allows."""
_NEWTON_STEPS = 12
"""Maximum number of Newton steps back onto equations. Heuristic: the method converges in four or never."""
_FAR = 2.0
"""Least rotation of the links that closes a gap, above which the gap is not constrained at a keyframe [rad].
Heuristic."""
_KEYFRAME_TURN = 0.5
"""Largest turn of a link that may be needed to bring a keyframe onto its equations [rad]. Heuristic."""


@dataclass(frozen=True, eq=False)
class UserLimit(LimitOf[CurveUnknowns]):
    """Limit that makes a motion satisfy all of the user's constraints and adds the user's costs to its objective.

    Attributes:
        terms: compiled constraints and costs.
        u: path parameter at which the constraints are evaluated.
        at_goal: whether the constraints at the goal are used instead of those during the motion.
        lead: largest amount of the path parameter by which the interval in which a constraint applies is extended on
            either side, so that a path that is smoothed at keyframes satisfies the constraint over the whole interval;
            intervals that are separated by a short gap stay separate.
    """

    terms: "UserTerms"
    u: float = 0.0
    at_goal: bool = False
    lead: float = 0.0

    @property
    def parametric(self) -> bool:
        """Whether any constraint or cost of the user depends on the path parameter."""
        return self.terms.parametric

    @property
    def has_equations(self) -> bool:
        """Whether any constraint is an equation, which a path may violate between keyframes that satisfy it."""
        return bool(self.terms.path_rows.equal.any())

    @property
    def shapes_path(self) -> bool:
        """Whether any constraint is an equation, or any constraint or cost depends on the path parameter."""
        return self.has_equations or self.terms.parametric

    @cached_property
    def breaks(self) -> tuple[float, ...]:
        """Path parameters in (0, 1) at which a constraint or cost starts or stops applying, increasing."""
        if self.lead == 0.0:
            return tuple(self.terms.breaks.tolist())
        way = self._way
        inside = np.unique(np.concatenate((way.first, way.last, self.terms.breaks)))
        return tuple(inside[(inside > 0.0) & (inside < 1.0)].tolist())

    @cached_property
    def _way(self) -> "RowSet":
        """Equations and inequalities at keyframes before the goal, with intervals widened by ``lead``."""
        exact = self.terms.motion_rows
        if self.lead == 0.0:
            return exact
        places = np.unique(np.concatenate(([0.0, 1.0], self.terms.breaks)))
        lead = min(self.lead, float(np.min(np.diff(places))) / 3.0)
        first = np.where(exact.first > 0.0, exact.first - lead, 0.0)
        last = np.where(exact.last < 1.0, exact.last + lead, 1.0)
        return replace(exact, first=first, last=last)

    @property
    def rows(self) -> "RowSet":
        """Equations and inequalities of the constraints, at the goal if ``at_goal`` is set, else before the goal."""
        return self.terms.goal_rows if self.at_goal else self._way

    def placed(self, u: float) -> "UserLimit":
        """Return a limit with the constraints that apply at the path parameter ``u``."""
        return replace(self, u=u)

    def placed_at_goal(self) -> "UserLimit":
        """Return a limit with the constraints that apply at the goal of the motion."""
        return replace(self, u=1.0, at_goal=True)

    def values(self, q: FloatArray) -> "RowValues":
        """Return the values and derivatives of the constraints at a configuration, shape (c,) [rad, m]."""
        return self.rows.at(q, self.u)

    def turns(self, slopes: FloatArray) -> FloatArray:
        """Return the largest change of each constraint value per radian of link rotation, never 0, shape (m,).

        It is the norm of the derivatives with respect to the link headings; link rotation is the root of the sum of
        squares over links. ``slopes`` are derivatives with respect to the configuration, shape (m, c).
        """
        return slope_norms(self.terms.quantities.heading_slopes(slopes))

    # ------------------------------------------------------------ the single step
    def linearised(self, space: CurveUnknowns, pose: Pose, turn: float) -> LimitRows:
        """Return constraints linearised for a QP step: equations, and an inequality for each gap that it could close.

        Equations have to be met by the step, or as far as half of the largest turn of a link allows.

        Args:
            space: unused.
            pose: pose from which the step starts.
            turn: largest turn of a link in the step [rad].
        """
        del space
        now = self.values(pose.q)
        equations, target = self._independent(now.equations, now.equation_slopes @ pose.slopes, pose.turning, turn)

        scale = self.turns(now.gap_slopes)
        # Cauchy–Schwarz: n links that turn by at most t each close a gap of unit slope by t √n to first order; the
        # factor 2 allows for second-order terms.
        farthest = 2.0 * turn * np.sqrt(self.terms.quantities.arm.links)  # largest gap that a step can close
        # Negated, so that a gap that is NaN keeps its row and is refused instead of being dropped.
        within = ~(now.gaps > (_MARGIN + farthest) * scale)
        scale = scale[within]
        gaps = now.gaps[within] / scale
        rows = now.gap_slopes[within] @ pose.slopes / scale[:, None]
        # Never above 0: δ = 0 stays feasible even inside the margin, where the pull opens the gap instead.
        lower = np.minimum(-0.5 * (gaps - _MARGIN), 0.0)
        return LimitRows(
            np.vstack((equations, rows)),
            np.concatenate((target, lower)),
            np.concatenate((target, np.full(len(rows), UNBOUNDED))),
            len(target),
            (self._pull(rows, gaps, turn),),
            lambda trial: self._keeps(now, self.values(trial.q)),
        )

    def _pull(self, rows: FloatArray, gaps: FloatArray, turn: float) -> Term:
        """Return the soft term of a QP step that opens gaps inside their margin, violated gaps with a higher weight.

        Args:
            rows: derivatives of the gaps with respect to the unknowns, shape (m, p).
            gaps: gaps, each as the least rotation of the links that closes it, shape (m,) [rad].
            turn: largest opening that is aimed at in the step [rad].
        """
        margin = _MARGIN
        near = gaps < margin
        short = margin - gaps[near]
        urgency = np.where(gaps[near] < 0.0, _URGENCY, 1.0)
        # Half of a shortfall at a time moves the arm gently; a violated gap has to be opened at once.
        wanted = np.where(gaps[near] < 0.0, short, 0.5 * short)
        return Term(urgency[:, None] * rows[near], urgency * np.minimum(wanted, turn), _PULL_WEIGHT)

    def _independent(
        self, equations: FloatArray, slopes: FloatArray, turning: FloatArray, turn: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return orthonormal combinations of linearised equations, shape (r, p), and the change that each needs, (r,).

        Dependent equations are left out. If the equations are far from satisfied, all changes are reduced so that no
        link turns by more than half of its bound and the QP stays feasible.

        Args:
            equations: values of the equations, shape (m,).
            slopes: derivatives with respect to the unknowns, shape (m, p).
            turning: angular velocities of the links for a unit of each unknown, shape (n, t, p) [rad].
            turn: largest turn of a link in the step [rad].
        """
        if not len(slopes):
            return slopes, equations

        # Dependent equations would make the QP degenerate. With J = U S Vᵀ, J δ = −c becomes Vᵀ δ = −S⁻¹ Uᵀ c on the
        # directions whose singular value counts.
        left, sizes, right = np.linalg.svd(slopes, full_matrices=False)
        kept = sizes > _RANK * max(float(sizes[0]), TINY)
        target = -(left.T @ equations)[kept] / sizes[kept]

        most = float(np.max(np.linalg.norm(turning @ (right[kept].T @ target), axis=1), initial=0.0))
        return right[kept], target * min(1.0, 0.5 * turn / max(most, TINY))

    def _keeps(self, before: "RowValues", after: "RowValues") -> bool:
        """Return whether a step is acceptable, from the constraint values before and after the step.

        Every gap has to keep a fraction of its margin, or not shrink. The equations have to be satisfied, or the sum of
        their residuals has to shrink.
        """
        # A pose that begins inside the margin may stay there, but must not lose more.
        floor = np.minimum(_KEEP_SHARE * _MARGIN * self.turns(before.gap_slopes), before.gaps)
        if not np.isfinite(after.violation) or not np.all(after.gaps >= floor - TINY):
            return False

        # Far from the equations their sum decides: one of them may grow for a step while the others shrink.
        met = np.max(np.abs(after.equations), initial=0.0) <= _MET
        return bool(met or np.abs(after.equations).sum() < np.abs(before.equations).sum())

    def restored(self, space: CurveUnknowns, pose: Pose, most: float) -> Pose:
        """Return a pose projected onto the user's equations by Newton's method, or the given pose if that fails.

        Args:
            space: map from the unknowns to configurations.
            pose: pose after a step.
            most: largest allowed turn of a link [rad].
        """
        if not self.rows.equal.any():
            return pose
        moved = self.moved_onto_rows(space, pose, most, gaps=False)
        return pose if moved is None else moved

    def moved_onto_rows(self, space: CurveUnknowns, pose: Pose, most: float, *, gaps: bool) -> Pose | None:
        """Return a pose projected onto the user's equations by Newton steps that move the links least, or None.

        Args:
            space: map from the unknowns to configurations.
            pose: pose to begin at.
            most: largest allowed turn of a link from the given pose [rad].
            gaps: whether violated gaps and joint limits are restored too.

        Returns:
            The pose; None if the method does not converge within ``most``.
        """
        start = pose
        limits = _JOINT_SHARE * space.bend_limits
        # Side to which each bend was too large on the way, else 0; ``overbent`` only adds to it.
        held = np.zeros(len(limits))
        for _ in range(_NEWTON_STEPS):
            values = self.values(pose.q)
            if not np.isfinite(values.violation):
                return None
            slopes = values.equation_slopes @ pose.slopes
            # Newton: J δ = −c, with the rows of violated gaps and excessive bends below those of the equations.
            change = -values.equations
            if gaps:
                slopes, change = self.missed(space, pose)
                over, back = overbent(limits, space.bends(pose.q), held, _MET)
                slopes = np.vstack((slopes, space.bend_slopes(pose)[over]))
                change = np.append(change, back)
            if np.max(np.abs(change), initial=0.0) <= _MET:
                return pose
            pose = space.pose(pose.v + least_change(space, pose, slopes, change))
            # Farther away may lie another branch of the equations, and the motion in between is unchecked.
            if not np.max(np.linalg.norm(start.turning @ (pose.v - start.v), axis=1)) <= most:
                return None
        return None

    # ------------------------------------------------------------ at the goal
    def miss(self, q: FloatArray) -> float:
        """Return the largest violation of a constraint in a configuration (c,), in its unit; 0 if within tolerance."""
        miss = self.values(q).violation
        return 0.0 if miss <= _MET_AT_GOAL else miss

    def restoration(self, pose: Pose, most: float) -> tuple[FloatArray, FloatArray]:
        """Return the equations, and the gaps smaller than their margin, linearised, with the changes that they require.

        They are scaled so that changes are link rotations.

        Args:
            pose: pose at which the constraints are linearised.
            most: bound on the required changes [rad].

        Returns:
            Derivatives with respect to the unknowns, shape (k, p), and required changes, at most ``most``, shape (k,)
            [rad].
        """
        values = self.values(pose.q)
        margins = _MARGIN * self.turns(values.gap_slopes)
        short = values.gaps < margins
        by_pose = np.vstack((values.equation_slopes, values.gap_slopes[short]))
        scale = self.turns(by_pose)
        wanted = np.append(-values.equations, margins[short] - values.gaps[short]) / scale
        return by_pose @ pose.slopes / scale[:, None], np.clip(wanted, -most, most)

    def missed(self, space: CurveUnknowns, pose: Pose) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of equations and violated gaps at a pose, and the changes that satisfy them.

        Returns:
            Derivatives with respect to the unknowns, shape (k, p), and changes in the user's units, shape (k,).
        """
        del space
        values = self.values(pose.q)
        broken = values.gaps < 0.0
        slopes = np.vstack((values.equation_slopes, values.gap_slopes[broken]))
        # Aimed slightly beyond 0, because rounding would otherwise leave the gap violated and Newton would iterate in
        # vain.
        aim = _KEEP_SHARE * _MARGIN * self.turns(values.gap_slopes[broken])
        return slopes @ pose.slopes, np.append(-values.equations, aim - values.gaps[broken])

    # ------------------------------------------------------------ the optimisation of a motion
    def at_keyframe(self, k: int, u: FloatArray) -> "UserLimit":
        """Return a limit with the constraints that apply at keyframe k of a motion; the last keyframe is the goal.

        ``u`` are the path parameters of the keyframes, shape (K + 1,).
        """
        return self.placed_at_goal() if k == len(u) - 1 else self.placed(float(u[k]))

    def keyframe_equations(self, sweep: "Sweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the user's equations, linearised at every keyframe but the first, scaled to derivatives of norm 1.

        Args:
            sweep: the motion.
            u: path parameters of the keyframes, shape (K + 1,).
        """
        keyframes: list[int] = []
        rows = [np.zeros((0, sweep.unknowns.shape[1]))]
        # Rows of norm 1 keep the QP well scaled whatever unit the user chose. Keyframe 0 is the start, which is fixed.
        for k in range(1, len(u)):
            slopes = self.at_keyframe(k, u).values(sweep.configurations[k]).equation_slopes @ sweep.slopes[k]
            rows.append(slopes / slope_norms(slopes)[:, None])
            keyframes += [k] * len(slopes)
        zero = np.zeros(len(keyframes))
        return (KeyframeRows(np.array(keyframes, dtype=np.intp), np.vstack(rows), zero, zero, "constraints"),)

    def keyframe_rows(self, sweep: "Sweep", u: FloatArray) -> tuple[KeyframeRows, ...]:
        """Return the user's inequalities that are nearly violated at keyframes, linearised.

        They are scaled so that a gap is the least rotation of the links that closes it [rad].

        Args:
            sweep: the motion.
            u: path parameters of the keyframes, shape (K + 1,).
        """
        keyframes: list[int] = []
        rows = [np.zeros((0, sweep.unknowns.shape[1]))]
        least = [np.zeros(0)]
        for k in range(1, len(u)):
            values = self.at_keyframe(k, u).values(sweep.configurations[k])
            scale = self.turns(values.gap_slopes)
            near = values.gaps < _FAR * scale
            scale = scale[near]
            rows.append(values.gap_slopes[near] @ sweep.slopes[k] / scale[:, None])
            # These rows are hard and have no slack: a gap inside its margin is only forbidden to shrink, or no step
            # would be feasible.
            least.append(np.minimum(_MARGIN - values.gaps[near] / scale, 0.0))
            keyframes += [k] * len(scale)
        lower = np.concatenate(least)
        upper = np.full(len(lower), UNBOUNDED)
        return (KeyframeRows(np.array(keyframes, dtype=np.intp), np.vstack(rows), lower, upper, "constraints"),)

    def costs(self, space: CurveUnknowns, u: FloatArray) -> tuple[MotionCost, ...]:
        """Return the user's costs of a motion, including soft constraints, for keyframes at path parameters ``u``."""
        del space
        return (UserCosts(self.terms, u),)

    def restored_keyframes(self, space: CurveUnknowns, coordinates: FloatArray, u: FloatArray) -> FloatArray:
        """Return keyframes (K + 1, p), the inner ones moved so that they satisfy the user's constraints.

        Keyframes for which Newton's method fails are unchanged.

        Args:
            space: map from the unknowns to configurations.
            coordinates: unknowns at the keyframes, shape (K + 1, p).
            u: path parameters of the keyframes, shape (K + 1,).
        """
        restored = coordinates.copy()
        for k in range(1, len(u) - 1):
            limit = self.at_keyframe(k, u)
            moved = limit.moved_onto_rows(space, space.pose(restored[k]), _KEYFRAME_TURN, gaps=True)
            if moved is not None:
                restored[k] = moved.v
        return restored

    def holds(self, sweep: "Sweep", before: "Sweep", u: FloatArray) -> bool:
        """Return whether all keyframes of a motion but the first satisfy the user's constraints.

        ``u`` are the path parameters of the keyframes, shape (K + 1,).
        """
        del before
        return all(self.at_keyframe(k, u).miss(sweep.configurations[k]) <= 0.0 for k in range(1, len(u)))

    # ------------------------------------------------------------ between keyframes
    @cached_property
    def _lasting(self) -> BoolArray:
        """Mask (rows,) of the inequalities that apply over the whole motion and do not depend on the path parameter."""
        rows = self.terms.path_rows
        return np.asarray(~rows.equal & (rows.first <= 0.0) & (rows.last >= 1.0) & ~rows.parametric)

    def failures(self, q: FloatArray, depth: int | None = None) -> IntArray:
        """Return indices of intervals of a piecewise-linear motion with samples at which a gap is below its reserve.

        A gap that is below its reserve at an end of the interval, as a start or a goal may be, must not shrink in
        between.

        Args:
            q: configurations at the keyframes, shape (K, c) [rad, m].
            depth: unused, as no interval is bisected.
        """
        del depth
        lasting = self._lasting
        if not lasting.any():
            return np.zeros(0, dtype=np.intp)
        rows = self.terms.path_rows
        share = np.linspace(0.0, 1.0, _SAMPLES + 1)[:, None]
        between = q[:-1, None] + share * np.diff(q, axis=0)[:, None]
        gaps = rows.table(between.reshape(-1, q.shape[1]))[:, lasting].reshape(*between.shape[:2], -1)
        # The reserve is an angle of the whole arm; a slope turns it into the unit of its gap.
        steepest = np.max([self.turns(np.asarray(rows.slopes(end, 0.0)[1])) for end in q[[0, -1]]], axis=0)
        reserve = _RESERVE * _KEEP_SHARE * _MARGIN * steepest[lasting]
        ends = np.minimum(gaps[:, 0], gaps[:, -1])
        floor = np.where(ends >= reserve, reserve, np.clip(ends, -_ALLOWED, -self._slack))
        # Negated, so that NaN counts as a failure.
        return np.flatnonzero(np.any(~(gaps >= floor[:, None]), axis=(1, 2)))

    @property
    def _slack(self) -> float:
        """Largest violation of a user's inequality that is accepted between keyframes, in the user's unit."""
        return _PATH_SHARE * _ALLOWED

    # ------------------------------------------------------------ the smooth path
    def path_violations(self, q: FloatArray, u: float) -> tuple[FloatArray, FloatArray]:
        """Return the user's equations and nearly violated inequalities at a point of the smooth path, for its repair.

        Args:
            q: configuration, shape (c,) [rad, m].
            u: path parameter.

        Returns:
            Derivatives with respect to the configuration, shape (k, c), and required changes in the user's units, shape
            (k,).
        """
        values = self.terms.path_rows.at(q, u)
        reserve = _RESERVE * _KEEP_SHARE * _MARGIN * self.turns(values.gap_slopes)
        # The certificate demands the reserve, by the steepest slope at the ends; between its knots a path has smaller
        # gaps than at the knots.
        broken = values.gaps < 0.5 * _KNOT_RESERVES * reserve
        slopes = np.vstack((values.equation_slopes, values.gap_slopes[broken]))
        return slopes, np.append(-values.equations, _KNOT_RESERVES * reserve[broken] - values.gaps[broken])

    def misses_path(self, q: FloatArray, u: FloatArray) -> BoolArray:
        """Return a mask of the samples of a path at which a constraint is violated by more than is accepted, (K,).

        Args:
            q: configurations, shape (K, c) [rad, m].
            u: path parameters, shape (K,).
        """
        rows = self.terms.path_rows
        table = rows.table(q, u)
        miss = np.where(rows.equal, np.abs(table), -table)
        return np.asarray(np.any(miss > self._slack, axis=1))

    # ------------------------------------------------------------ ends and words
    @property
    def names(self) -> tuple[str, ...]:
        """Names of the user's hard constraints."""
        return tuple(hard.constraint.name for hard in self.terms.hard)

    @property
    def advice(self) -> tuple[str, ...]:
        """Advice to the user if no motion is found."""
        return ("relax the constraints, or make them soft",)

    def refuse_ends(self, start: FloatArray, goal: FloatArray | None) -> None:
        """Check that the start and a whole-arm goal satisfy the user's constraints and that all values are finite.

        Args:
            start: configuration at the start, shape (c,) [rad, m].
            goal: configuration at the goal, shape (c,) [rad, m], or None for a goal of the tip.

        Raises:
            ProblemError: the start violates a constraint, or a value is not finite at the start.
            UnreachableGoal: the goal violates a constraint.
        """
        refuse_broken_start(self.terms, start, _ALLOWED)
        if goal is not None:
            refuse_broken_goal(self.terms, goal, _ALLOWED)

    def worst(self, q: FloatArray) -> tuple[str, float]:
        """Return the name of the constraint that a configuration (c,) violates most, and the violation in its unit.

        Violations of different units are compared by the least rotation of the links that removes them.
        """
        rows = self.rows
        table = rows.table(q[None], self.u)[0]
        miss = np.where(rows.equal, np.abs(table), np.maximum(-table, 0.0))
        # The table holds NaN where a row does not apply at this u.
        if np.all(np.isnan(miss)):
            return "", 0.0
        k = int(np.nanargmax(miss / self._slope_norms(q)))
        return rows.names[k], float(miss[k])

    def describe(self, q: FloatArray) -> str:
        """Return a description of a constraint that a configuration (c,) violates or just meets, or "" if none."""
        name, miss = self.worst(q)
        if miss > _MET_AT_GOAL:
            return f"constraint '{name}' is violated by {miss:.3g}"
        rows = self.rows
        turns = rows.table(q[None], self.u)[0] / self._slope_norms(q)
        near = ~rows.equal & (turns < 2.0 * _MARGIN)
        return f"constraint '{rows.names[int(np.flatnonzero(near)[0])]}' is at its bound" if near.any() else ""

    def _slope_norms(self, q: FloatArray) -> FloatArray:
        """Return ``turns`` of all constraint values at a configuration (c,), shape (rows,).

        Constraints that do not apply at the path parameter are included.
        """
        return self.turns(np.asarray(self.rows.slopes(q, self.u)[1]))
