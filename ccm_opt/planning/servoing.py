"""Servo control of the tip: a motion made tick by tick after a commanded velocity, which can be braked at any time.

The motion is a uniform cubic B-spline of configurations with one control point a tick. Its position, velocity and
acceleration at any time are convex combinations of control points, of their first differences over the tick, and of
their second differences over its square. So limits that the differences keep are kept at all times.

Every tick adds one control point, by a quadratic program in the unknowns v of the curve. A change δ of them in one tick
is followed by changes δ (1 − j / N), j = 1 … N − 1, that brake the arm to rest: together a change of Δ = ½ (N + 1) δ.
The program is stated for Δ, that is for the pose in which the arm would come to rest, by the same linearised limits as
any step of planning. The number of ticks N is that in which the arm can be braked from its greatest velocities, so that
no braking exceeds the limits on accelerations.

The control point is taken only if the tick and the braking after it are certified. Otherwise the change is drawn
towards that of the braking, and if nothing helps, the arm goes on with the braking that is certified already.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ccm_opt.core.arrays import TINY, FloatArray, IntArray
from ccm_opt.core.small_qp import solve_small_qp
from ccm_opt.planning.limits.limit import UNBOUNDED, LimitOf, LimitRows, restored_keyframes, stacked_rows
from ccm_opt.planning.limits.limit_stack import ContactLimit, JointLimit, TurnLimit
from ccm_opt.planning.pose import CurveUnknowns, Pose, Term, normal_equations
from ccm_opt.planning.servo_state import Braking, Cut, ServoState, TipVelocity, spline_values, spline_weights
from ccm_opt.robot.coordinates import DriveLimits

_BRAKING = 0.5
"""Longest time of braking [s]: where brakes are weaker, the arm moves more slowly. Heuristic."""
_ROWS_SHARE = 0.998
"""Fraction of the rate limits that the program uses, since its solution and its linearisation are not exact."""
_SHARES = (1.0, 0.4, 0.1)
"""Fractions of the way from braking to the program's solution that are tried until one is certified. Heuristic."""
_KEPT_SHARE = 0.99
"""Fraction of the rate limits up to which such a fraction is interpolated where the first one exceeds them."""
_TIP = 30.0
"""Weight of the tip's velocity, with distances in nominal links, as that of guides of planning."""
_TIP_TURN = 30.0
"""Weight of the tip's angular velocity, with angles in radians. Heuristic."""
_FOLLOWING = 0.03
"""Weight of changes of the curve on which a fed arm lies: a small one lets the body follow the tip. Heuristic."""
_TURN = 0.5
"""Largest turn of a planar link until the arm rests [rad]. Heuristic."""
_ITERATIONS_A_ROW = 8
"""Maximum number of QP iterations per constraint, as for steps of planning."""
_ROUNDING = 1e-9
"""Relative excess over a limit that counts as rounding."""
_CLOSING_SHARE = 0.5
"""Fraction of its distance from a limit by which a coordinate may close until rest."""
_RIDGE = 1e-8
"""Value on the diagonal of the program's Hessian that makes it positive definite."""
_FOLLOWED = 0.01
"""Part of the commanded velocity by which the tip's may differ without a reason."""
_ACTIVE = 1e-4
"""Distance from its bound, in nominal links or radians, at which a constraint counts as a reason: above the QP's
accuracy."""
_SLOW = 0.01
"""Least speed to which lost velocities are compared, in nominal links per second and in radians per second: below, the
accuracy of the QP would count."""
_STRETCHED = 0.05
"""Motion of the tip in the commanded direction, as a fraction of that in all, below which the arm is stretched."""
_CURVED = 2
"""Number of spans with control points of the motion before the tick: in affine maps, the braking after them is straight
because its control points lie on a line."""


@dataclass(frozen=True, eq=False)
class TipServo:
    """Maker of motions that follow commanded velocities of the tip, tick by tick, and can always be braked.

    Attributes:
        curve: map from the unknowns to configurations.
        limits: all limits of the arm's motion but those on rates and efforts.
        rates: limits on velocities and accelerations of the coordinates, each of shape (c,).
        spare: certified gap beyond contact, by which the spline may deviate from certified chords [length].
        period: duration of a tick [s].
        depth: allowed number of bisections of certificates; None for the certificate's setting.
        efforts: function from positions, velocities and accelerations, each of shape (m, c), to the drive whose effort
            exceeds its limit most, or None; None if no effort is limited.
    """

    curve: CurveUnknowns
    limits: tuple[LimitOf[Any], ...]
    rates: DriveLimits
    spare: float
    period: float
    depth: int | None = None
    efforts: Callable[[FloatArray, FloatArray, FloatArray], Cut | None] | None = None

    # ------------------------------------------------------------ rates
    @cached_property
    def braking_ticks(self) -> int:
        """Number N of ticks in which the arm is braked from its greatest velocities."""
        seconds = min(_BRAKING, float(np.max(self.rates.velocity / self.rates.acceleration)))
        return max(2, int(np.ceil(seconds / self.period - _ROUNDING)))

    @cached_property
    def _most(self) -> tuple[FloatArray, FloatArray]:
        """Largest first and second differences of control points, each of shape (c,)."""
        second = self.rates.acceleration * self.period**2
        return np.minimum(self.rates.velocity * self.period, self.braking_ticks * second), second

    @property
    def seconds_to_rest(self) -> float:
        """Displacement of a joint until the arm rests, in units of its velocity in the next tick [s]."""
        return self._until_rest * self.period

    @property
    def _until_rest(self) -> float:
        """Change of the unknowns until the arm rests, in changes of the next tick."""
        return 0.5 * (self.braking_ticks + 1)

    @cached_property
    def _fading(self) -> FloatArray:
        """Change of the unknowns up to each tick of a braking, in changes until the arm rests, shape (N, 1)."""
        fading = np.cumsum(1.0 - np.arange(self.braking_ticks) / self.braking_ticks) / self._until_rest
        fading[-1] = 1.0
        return fading[:, None]

    @cached_property
    def _rated(self) -> IntArray | None:
        """Indices of the coordinates whose rates the program bounds: one of each set that moves together.

        It is None if slopes vary: all coordinates that move at a pose.
        """
        if not self.curve.affine:
            return None
        rows = self.curve.pose(np.zeros(self.curve.dimension)).slopes / self._most[1][:, None]
        _, first = np.unique(np.round(rows, 9), axis=0, return_index=True)
        return np.array([k for k in np.sort(first) if np.any(rows[k])], dtype=np.intp)

    # ------------------------------------------------------------ ticks
    def at_rest(self, v: FloatArray) -> ServoState:
        """Return the state of rest at unknowns of shape (p,)."""
        q = self.curve.configurations(v[None])
        nothing = Braking(np.zeros((0, len(v))), np.zeros((0, q.shape[1])))
        return ServoState(np.repeat(q, 3, axis=0), np.stack((v, v)), nothing)

    def stepped(self, state: ServoState, pose: Pose, command: TipVelocity) -> tuple[ServoState, tuple[Cut, ...]]:
        """Return the state a tick later, and the reasons why the tip moves otherwise than commanded.

        Args:
            state: the state.
            pose: pose of the state's last control point.
            command: commanded motion of the tip.
        """
        if command.at_rest:
            return state.continued(), ()
        # Where the present velocity leads if the arm is braked from now on, as slowly as from its greatest velocities.
        braked = self._until_rest * (1.0 - 1.0 / self.braking_ticks) * (state.unknowns[1] - state.unknowns[0])
        rests, cuts = self._program(state, pose, command, braked)
        if rests is None:
            return state.continued(), cuts
        first: Cut | None = None
        shares = list(_SHARES)
        slow, fast = self._slowest(state, braked), self._braking(pose.v, pose.v + self._fading * rests)
        while shares:
            share = shares.pop(0)
            mixed = slow.unknowns + share * (fast.unknowns - slow.unknowns)
            trial = fast if share == _SHARES[0] else self._braking(pose.v, mixed)
            refusal = self._refusal(state, pose, trial)
            if refusal is None:
                return state.taking(trial), (*cuts, *([first] if first else []))
            first = first or refusal
            if refusal.kind == "certificate":
                # What is not certified hardly ever is so with a change that is a little smaller: it would cost time.
                shares = shares[-1:]
            elif refusal.kind in {"velocity", "acceleration"} and share == _SHARES[0]:
                shares[0] = self._share_within_rates(state, slow, fast)
        return state.continued(), (*cuts, *([first] if first else []))

    def _slowest(self, state: ServoState, braked: FloatArray) -> Braking:
        """Return the braking towards which changes are drawn, to N control points.

        It is the one that is held, which is certified, if configurations are no affine functions of the unknowns. If
        they are, it is that from the present velocity, because ``chords`` takes it that all braking is straight.

        Args:
            state: the state.
            braked: change of the unknowns in that from the present velocity, shape (p,).
        """
        if self.curve.affine:
            return self._braking(state.unknowns[1], state.unknowns[1] + self._fading * braked)
        held = state.braking
        at_rest = np.vstack((state.unknowns, held.unknowns))[-1:], state.to_rest()[-1:]
        unknowns, controls = (np.repeat(rest, self.braking_ticks, axis=0) for rest in at_rest)
        unknowns[: len(held.unknowns)], controls[: len(held.controls)] = held.unknowns, held.controls
        return Braking(unknowns, controls)

    def _share_within_rates(self, state: ServoState, braked: Braking, trial: Braking) -> float:
        """Return the fraction of the way from one continuation to another that keeps the rates by interpolation."""
        share = 1.0
        slow, fast = (replace(state, braking=each).to_rest() for each in (braked, trial))
        for n, limit in ((1, self.rates.velocity * self.period), (2, self.rates.acceleration * self.period**2)):
            room = _KEPT_SHARE * limit - np.sign(np.diff(fast, n, axis=0)) * np.diff(slow, n, axis=0)
            past = np.abs(np.diff(fast, n, axis=0)) - _KEPT_SHARE * limit
            share = min(share, float(np.min((room / np.maximum(room + past, TINY))[past > 0.0], initial=1.0)))
        return max(share, _SHARES[-1])

    def _braking(self, v: FloatArray, unknowns: FloatArray) -> Braking:
        """Return the continuation to rest from unknowns (p,) over others (m, p), moved so that they satisfy limits."""
        around = np.vstack((v, unknowns))
        unknowns = restored_keyframes(self.limits, self.curve, around, np.linspace(0.0, 1.0, len(around)))[1:]
        return Braking(unknowns, self.curve.configurations(unknowns))

    # ------------------------------------------------------------ the program
    def _program(
        self, state: ServoState, pose: Pose, command: TipVelocity, braked: FloatArray
    ) -> tuple[FloatArray | None, tuple[Cut, ...]]:
        """Return the change of the unknowns until the arm rests, shape (p,), and what bounds it; None in vain."""
        parts = [_closing(limit, limit.linearised(self.curve, pose, _TURN)) for limit in self.limits]
        parts.append(self._rate_rows(state, pose))
        terms = [*self._tip_terms(pose, command), *(pull for rows in parts for pull in rows.pulls)]
        hessian, gradient = normal_equations(terms, _RIDGE)
        matrix, lower, upper, sense = stacked_rows(parts)
        most = _ITERATIONS_A_ROW * len(upper)
        # Unknowns of curves that hardly any joint is on are of another size than the others.
        scale = 1.0 / np.sqrt(np.diag(hessian))
        program = hessian * scale * scale[:, None], gradient * scale, matrix * scale
        rests = solve_small_qp(*program, upper, lower, sense.copy(), most)
        if rests is None:
            # Braking stays possible, whatever the linearisation says: it is certified.
            values = np.where(sense == 0, matrix @ braked, 0.0)
            lower, upper = np.minimum(lower, values), np.maximum(upper, values)
            rests = solve_small_qp(*program, upper, lower, sense, most)
        if rests is None or not np.isfinite(rests).all():
            return None, (Cut("unsolved", "", 0.0, 0.0, ""),)
        rests = scale * rests
        for rows in parts:
            # Equations hold single joints straight: exactly, not to the accuracy of the solver.
            held = rows.matrix[: rows.equations]
            rests = rests - held.T @ (held @ rests)
        if max(self.lost(state, pose, command, rests / self._until_rest)) <= _FOLLOWED:
            return rests, ()
        cuts = [*self._stretched(pose, command), *self._bounds(state, pose, parts, rests)]
        return rests, tuple(cuts or self._soft(pose, command))

    def lost(self, state: ServoState, pose: Pose, command: TipVelocity, change: FloatArray) -> tuple[float, float]:
        """Return the fractions of a commanded velocity and angular velocity that the tip does not follow.

        They are fractions of the commanded speed or, if greater, of the present one, or of a hundredth of a nominal
        link or radian per second.

        Args:
            state: state at the beginning of the tick.
            pose: pose of the state's last control point.
            command: commanded motion of the tip.
            change: change of the unknowns in the tick, shape (p,).
        """
        before = state.unknowns[1] - state.unknowns[0]
        rates = [(pose.moving[-1], command.linear, _SLOW * self.curve.nominal_length)]
        if command.angular is not None:
            rates.append((self._turning(pose, command), command.angular, _SLOW))
        linear, *angular = (
            float(np.linalg.norm(rows @ change / self.period - wanted))
            / max(float(np.linalg.norm(wanted)), float(np.linalg.norm(rows @ before)) / self.period, slow)
            for rows, wanted, slow in rates
        )
        return linear, angular[0] if angular else 0.0

    @staticmethod
    def _turning(pose: Pose, command: TipVelocity) -> FloatArray:
        """Return the derivatives of the tip's turns about the controlled axes, shape (k, p)."""
        rows = pose.turning[-1]
        return rows if command.axes is None else np.asarray(command.axes @ rows)

    def _tip_terms(self, pose: Pose, command: TipVelocity) -> list[Term]:
        """Return the terms of the program that move the tip as commanded and keep the body on its curve."""
        seconds = self.seconds_to_rest
        unit = self.curve.nominal_length
        terms = [Term(pose.moving[-1] / unit, seconds * command.linear / unit, _TIP)]
        if command.angular is not None:
            terms.append(Term(self._turning(pose, command), seconds * command.angular, _TIP_TURN))
        following = unit * self.curve.following_rows
        if len(following):
            terms.append(Term(following, np.zeros(len(following)), _FOLLOWING))
        return terms

    def _rate_rows(self, state: ServoState, pose: Pose) -> LimitRows:
        """Return the bounds on velocities and accelerations of the next tick, for a change until rest."""
        first, second = (_ROWS_SHARE * most for most in self._most)
        before = state.controls[2] - state.controls[1]
        kept = np.flatnonzero(np.any(pose.slopes != 0.0, axis=1)) if self._rated is None else self._rated
        low, high = np.maximum(-first, before - second)[kept], np.minimum(first, before + second)[kept]
        return LimitRows(pose.slopes[kept], self._until_rest * low, self._until_rest * high)

    def _stretched(self, pose: Pose, command: TipVelocity) -> Iterator[Cut]:
        """Yield the reason, if it is one, that hardly any joint moves or turns the tip as commanded."""
        wanted = [(command.linear, pose.moving[-1])]
        if command.angular is not None:
            wanted.append((command.angular, self._turning(pose, command)))
        for velocity, rows in wanted:
            speed = float(np.linalg.norm(velocity))
            gain = float(np.linalg.norm(velocity @ rows) / max(float(np.linalg.norm(rows)), TINY))
            if gain < _STRETCHED * speed:
                yield Cut("stretched", "the arm", gain / speed, _STRETCHED, "")
                return

    def _bounds(self, state: ServoState, pose: Pose, parts: Sequence[LimitRows], rests: FloatArray) -> Iterator[Cut]:
        """Yield the limits that bound the program's solution, at most one of each kind."""
        found: dict[str, Cut] = {}
        for limit, rows in zip(self.limits, parts, strict=False):
            values = rows.matrix @ rests
            near = _ACTIVE * (self.curve.nominal_length if isinstance(limit, ContactLimit) else 1.0)
            active = np.flatnonzero((values <= rows.lower + near) | (values >= rows.upper - near))
            active = active[(active >= rows.equations) & np.any(rows.matrix[active] != 0.0, axis=1)]
            if not len(active):
                continue
            if isinstance(limit, ContactLimit):
                contacts = limit.finder.find(pose.points)
                link, other, gap = limit.finder.named(contacts, int(active[np.argmin(contacts.gap[active])]))
                yield Cut("contact", f"{link} and {other}", gap, 0.0, "m")
                continue
            for row in rows.matrix[active]:
                cut = self._row_cut(limit, row, pose, rests)
                if cut is not None:
                    found.setdefault(cut.kind, cut)
        yield from found.values()
        change = pose.slopes @ rests / self._until_rest
        before = state.controls[2] - state.controls[1]
        for kind, used, limits in (
            ("velocity", np.abs(change) / self._most[0], self._most[0] / self.period),
            ("acceleration", np.abs(change - before) / self._most[1], self.rates.acceleration),
        ):
            if np.max(used) > 0.99 * _ROWS_SHARE:
                k = int(np.argmax(used))
                yield self._rate_cut(kind, k, float(used[k] * limits[k]), float(limits[k]))

    def _row_cut(self, limit: LimitOf[Any], row: FloatArray, pose: Pose, rests: FloatArray) -> Cut | None:
        """Return the reason that a row (p,) of a limit's constraints bounds the solution; None if it holds a joint."""
        arm = self.curve.arm
        if isinstance(limit, TurnLimit):
            return Cut("turn", "a link", _TURN, _TURN, "rad")
        # A row that bounds one coordinate is a multiple of that coordinate's slopes.
        sizes = np.linalg.norm(pose.slopes, axis=1)
        along = np.abs(pose.slopes @ row) / np.maximum(sizes * np.linalg.norm(row), TINY)
        index = int(np.argmax(along))
        if along[index] < 1.0 - _ROUNDING:
            if arm.feed is None:
                return None
            first = int(np.argmin(arm.held(float(np.sum(pose.q[arm.coordinates.base])))))
            return Cut("guide tube", f"joint {first + 1}", float(pose.q[first]), 0.0, "rad")
        if arm.lower_limits[index] >= arm.upper_limits[index]:
            return None
        kind = "joint limit" if index < arm.coordinates.joints else "base range"
        return self._at_limit(kind, index, pose.q + pose.slopes @ rests)

    def _soft(self, pose: Pose, command: TipVelocity) -> Iterator[Cut]:
        """Yield the reason why the tip does not follow though no limit bounds it: what else the program asks for."""
        for limit in self.limits:
            if isinstance(limit, ContactLimit):
                contacts = limit.finder.find(pose.points)
                beyond = contacts.gap - contacts.margin
                if np.min(beyond, initial=0.0) < 0.0:
                    link, other, gap = limit.finder.named(contacts, int(np.argmin(beyond)))
                    yield Cut("clearance", f"{link} and {other}", gap, 0.0, "m")
                    return
        speed = max(float(np.linalg.norm(command.linear)), TINY)
        gain = float(np.linalg.norm(command.linear @ pose.moving[-1]) / np.linalg.norm(pose.moving[-1]))
        yield Cut("stretched", "the arm", gain / speed, _STRETCHED, "")

    def _at_limit(self, kind: str, index: int, q: FloatArray) -> Cut:
        """Return the reason that a coordinate of a configuration, shape (c,), is at an end of its range."""
        arm = self.curve.arm
        low, high = float(arm.lower_limits[index]), float(arm.upper_limits[index])
        value = float(q[index])
        layout = arm.coordinates
        return Cut(kind, layout.names[index], value, high if value > 0.5 * (low + high) else low, layout.units[index])

    def _rate_cut(self, kind: str, index: int, value: float, limit: float) -> Cut:
        """Return the reason that a coordinate uses up a limit on its velocity or acceleration."""
        layout = self.curve.arm.coordinates
        unit = f"{layout.units[index]}/s" + ("²" if kind == "acceleration" else "")
        return Cut(kind, layout.names[index], value, limit, unit)

    # ------------------------------------------------------------ what is certified
    def _refusal(self, state: ServoState, pose: Pose, trial: Braking) -> Cut | None:
        """Return why a tick and the braking after it cannot be taken; None if both are certified."""
        controls = replace(state, braking=trial).to_rest()
        return (
            self._rates_exceeded(controls)
            or self._out_of_range(trial.controls)
            or self._bent_in_tube(controls)
            or self._efforts_exceeded(controls)
            or self._uncertified(controls, pose)
        )

    def _rates_exceeded(self, controls: FloatArray) -> Cut | None:
        """Return which limit on rates is exceeded by differences of control points, shape (m, c); None if none is."""
        changes = np.diff(controls, axis=0)
        rates = (
            ("velocity", changes, self.period, self.rates.velocity),
            ("acceleration", np.diff(changes, axis=0), self.period**2, self.rates.acceleration),
        )
        for kind, values, unit, limit in rates:
            most = np.maximum(np.max(values, axis=0), -np.min(values, axis=0)) / unit
            if np.any(most > limit * (1.0 + _ROUNDING)):
                k = int(np.argmax(most / limit))
                return self._rate_cut(kind, k, float(most[k]), float(limit[k]))
        return None

    def _out_of_range(self, controls: FloatArray) -> Cut | None:
        """Return which coordinate is out of its range in control points, shape (m, c); None if none is."""
        if not any(isinstance(limit, JointLimit) and len(limit.failures(controls)) for limit in self.limits):
            return None
        arm = self.curve.arm
        past = np.maximum(controls - arm.upper_limits, arm.lower_limits - controls)
        k, index = np.unravel_index(int(np.argmax(past)), past.shape)
        kind = "joint limit" if index < arm.coordinates.joints else "base range"
        return self._at_limit(kind, int(index), controls[k])

    def _bent_in_tube(self, controls: FloatArray) -> Cut | None:
        """Return which joint is bent on a span on which it is inside the guide tube, for control points (m, c)."""
        arm = self.curve.arm
        if arm.feed is None:
            return None
        layout = arm.coordinates
        windows = _windows(controls)
        held = arm.held(np.min(windows[:, :, layout.joints], axis=1))
        most = np.max(np.abs(windows[:, :, : layout.joints]), axis=1)
        bent = np.max(most.reshape(len(windows), arm.links, -1), axis=-1)
        inside = np.where(held, bent, 0.0)
        span, joint = np.unravel_index(int(np.argmax(inside)), inside.shape)
        if inside[span, joint] <= TINY:
            return None
        return Cut("guide tube", f"joint {joint + 1}", float(inside[span, joint]), 0.0, "rad")

    def _efforts_exceeded(self, controls: FloatArray) -> Cut | None:
        """Return which drive needs too large an effort along a spline, at both ends and amid its spans."""
        if self.efforts is None:
            return None
        states = [spline_values(controls, self.period, share) for share in (0.0, 0.5)]
        return self.efforts(*(np.vstack(each) for each in zip(*states, strict=True)))

    def _uncertified(self, controls: FloatArray, pose: Pose) -> Cut | None:
        """Return what is nearest to the arm at a pose if a spline with control points (m, c) is not certified."""
        chords = self.chords(controls)
        # What is refused mostly is so where the arm would rest: that is looked at first.
        parts = (chords[-2:], chords)
        if not any(len(limit.failures(part, self.depth)) for part in parts for limit in reversed(self.limits)):
            return None
        contact = next(limit for limit in self.limits if isinstance(limit, ContactLimit))
        found = contact.finder.tightest(contact.finder.find(pose.points))
        name = f"{found[0]} and {found[1]}" if found else ""
        return Cut("certificate", name, found[2] if found else np.inf, 0.0, "m")

    def chords(self, controls: FloatArray) -> FloatArray:
        """Return configurations on a spline with control points (m, c), whose chords it does not leave by more than s.

        Here s is half of the certified spare. Once control points run straight, the last configuration is enough.
        """
        spans = len(controls) - 3
        bows = self._bows(controls)
        # The braking is straight in an affine map, and otherwise nearly so: where it bows less than allowed, several
        # spans share a chord.
        bow = 0.0 if self.curve.affine else np.max(bows[_CURVED:], initial=0.0)
        curved = spans if bow > 1.0 else min(_CURVED, spans)
        parts = np.ceil(np.sqrt(bows[:curved])).astype(np.intp).tolist()
        # Spans, and shares of their times.
        places = [(span, part / count) for span, count in enumerate(parts) for part in range(count)]
        joined = spans if self.curve.affine else int(np.sqrt(1.0 / max(bow, TINY)))
        places += [(span, 0.0) for span in range(curved, spans, max(joined, 1))]
        places.append((spans - 1, 1.0))
        weights = np.array([spline_weights(share)[0] for _, share in places])
        return np.asarray(np.einsum("mk,mkc->mc", weights, _windows(controls)[[span for span, _ in places]]))

    def parts(self, controls: FloatArray) -> IntArray:
        """Return into how many chords each span of a spline with control points (m + 3, c) is divided, shape (m,)."""
        return np.asarray(np.ceil(np.sqrt(self._bows(controls))).astype(np.intp))

    def _bows(self, controls: FloatArray) -> FloatArray:
        """Return bounds on the deviation of a spline from the chords of its spans, in halves of the spare, shape (m,).

        They are at least tiny. Over a chord of k spans, or of the k-th part of one, a bound is k² times as large.
        """
        arm = self.curve.arm
        second = np.abs(np.diff(controls, n=2, axis=0))
        # Half-way between two points a time h apart, a curve is off its chord by at most ⅛ h² times its acceleration.
        bows = arm.coordinates.travel(np.maximum(second[:-1], second[1:]) / 8.0, arm.lengths)
        return np.maximum(2.0 * bows / self.spare, TINY)


def _windows(controls: FloatArray) -> FloatArray:
    """Return the four control points of every span of a spline with control points (m + 3, c), shape (m, 4, c)."""
    return np.asarray(controls[np.arange(len(controls) - 3)[:, None] + np.arange(4)])


def _closing(limit: LimitOf[Any], rows: LimitRows) -> LimitRows:
    """Return constraints that let every distance from a limit close by at most a share, as those of contacts do.

    If a motion takes a share up to ½ (1 + 1 / N) of a distance until rest, it can still be braked a tick later.
    """
    if isinstance(limit, ContactLimit):
        return rows
    lower, upper = (
        np.where(np.abs(bounds) < UNBOUNDED, _CLOSING_SHARE * bounds, bounds) for bounds in (rows.lower, rows.upper)
    )
    return replace(rows, lower=lower, upper=upper)
