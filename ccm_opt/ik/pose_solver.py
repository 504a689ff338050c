"""Numerical solution of the goal-pose NLP for one goal, start pose and set of convex regions."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import BoolArray, FloatArray
from ccm_opt.core.ipopt_call import ipopt_answer
from ccm_opt.ik.pose_program import PoseProgram
from ccm_opt.ik.pose_regions import JointRegions
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.row_program import IPOPT_SWITCHES, RowAnswer, built_solver, row_answer
from ccm_opt.ik.tip_roll import TipRoll
from ccm_opt.robot.arm import HELD_TOLERANCE, Arm
from ccm_opt.robot.biarc import bend_shares

_LIMIT_SHARE = 0.98
"""Fraction of a joint limit that a pose may use (as in the steps of the motion)."""
_USER_GAP = 0.05
"""Fraction of the preferred clearance that a pose keeps, however large the user's costs. Measured: with 0, poses in
the wing box have 0.1 mm less clearance than the certificate requires."""
_SIDES = (("left", "right"), ("down", "up"))
"""Names of the sides to which joints bend, for positive and negative bends."""


@dataclass(frozen=True, eq=False)
class ArmPose:
    """Result of the goal-pose NLP, feasible or not.

    Attributes:
        arm: the arm.
        q: configuration, clipped to the joint limits, shape (c,) [rad, m].
        curve: curve in the plane or in space whose mean directions the links follow.
        gap: least gap of any link to the sides of its region, at most the preferred clearance [m].
        answer: the solver's status, costs and violated constraints.
    """

    arm: Arm
    q: FloatArray
    curve: Any
    gap: float
    answer: RowAnswer

    @cached_property
    def headings(self) -> FloatArray:
        """Headings of the links in the plane, shape (links,) [rad]."""
        return self.arm.headings(self.q[: self.arm.links])


_SWITCHES: dict[str, Any] = {
    **IPOPT_SWITCHES,
    # Parameter sensitivities are not needed; the gradient for them would take a quarter of the building time.
    "calc_lam_p": False,
    "no_nlp_grad": True,
    # Residuals of the chain of links add up along the arm, to 200 times as much at the tip.
    "ipopt.constr_viol_tol": 1e-10,
}
_FROM_KEPT_ROWS: dict[str, Any] = {
    # From a start that satisfies every row the barrier parameter only has to decrease.
    "ipopt.mu_strategy": "monotone",
    # Small (measured: with 1e-2 solutions for arms behind holes are lost).
    "ipopt.mu_init": 1e-4,
    # Relative distance by which the start is moved off its bounds (measured: with the solver's default of a hundredth,
    # which exceeds any gap, two of the three shared problems do not converge; with this all do).
    **dict.fromkeys(("ipopt.bound_push", "ipopt.bound_frac", "ipopt.slack_bound_push", "ipopt.slack_bound_frac"), 1e-5),
}
_FROM_NEAR: dict[str, Any] = {"ipopt.mu_init": 1e-2}
"""IPOPT options for a start that violates constraints slightly: a small initial barrier parameter, because a pose of
the arm is known (heuristic; measured: with the options for a feasible start clutter takes a sixth more iterations)."""


@dataclass(frozen=True, eq=False)
class _BentBy:
    """What bends the joints of an arm: their bends, or drives that move several of them.

    Attributes:
        values: values in the start pose, shape (m,) [rad].
        limits: bounds on their absolute values, shape (m,) [rad].
        places: arc length that has to be out of a guide tube for each to move, shape (m,) [m].
    """

    values: FloatArray
    limits: FloatArray
    places: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseQuestion:
    """Input of one goal-pose NLP: a symbolic program with the goal, the start pose and the regions of the joints.

    Attributes:
        program: symbolic program, possibly with the user's constraints and costs.
        settings: settings of the NLP.
        weights: weights of the program's own cost terms, in the order of ``program.parts``.
        arm: the arm.
        position: goal of the tip, shape (d,) [m].
        direction: direction of the last link at the goal, a unit vector of shape (d,), or None.
        roll: required roll of the last link at the goal; None if any is allowed.
        near: configuration from which deviations are penalised, shape (c,) [rad, m].
        start: configuration from which the solver starts, usually inside its regions, shape (c,) [rad, m]. In the
            plane the heading of the last link keeps the number of whole turns of the start.
        regions: convex regions of every joint and of the tip.
        wanted_gap: gap beyond radius and required clearance above which more does not lower the cost [m].
        gravity: acceleration of gravity, shape (d,) [m/s²].
        clamped: whether the first link keeps its heading.
        room: tolerances of the tip position [m] and of the last link's direction [rad]; all poses within them are
            equally good.
        torque_limits: torque limit of each bend, shape (bends,), or of each drive that moves several, shape (m,) [N m];
            None if torque is not limited.
        base_weights: weight of the deviation of each axis that carries the base from that of ``near``, as in
            ``GoalPoses.base_weights``; None for a feed axis, or a fixed base.
    """

    program: PoseProgram
    settings: PoseSettings
    weights: FloatArray
    arm: Arm
    position: FloatArray
    direction: FloatArray | None
    roll: TipRoll | None
    near: FloatArray
    start: FloatArray
    regions: JointRegions
    wanted_gap: float
    gravity: FloatArray
    clamped: bool = False
    room: tuple[float, float] = (0.0, 0.0)
    torque_limits: FloatArray | None = None
    base_weights: FloatArray | None = None

    def solve(self) -> ArmPose:
        """Solve the NLP from the start pose and return the result, whether or not the solver converged.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed during the solution.
        """
        lower, upper = self.bounds
        row_lower, row_upper = self.program.bounds
        bounds = {"lbx": lower, "ubx": upper, "lbg": row_lower, "ubg": row_upper}
        options = {
            **_SWITCHES,
            **(_FROM_KEPT_ROWS if self.program.frames.start_keeps_rows else _FROM_NEAR),
            "ipopt.max_iter": self.settings.iterations,
            "ipopt.tol": self.settings.tolerance,
        }
        if self.program.magnitude > 1.0:  # the tolerance is for an objective of order one
            options["ipopt.obj_scaling_factor"] = 1.0 / self.program.magnitude
        solver = partial(built_solver, self.program, options, by_blocks=True)
        answer, statistics = ipopt_answer(solver, np.clip(self.start_values, lower, upper), p=self.parameters, **bounds)
        return self._read(answer, statistics)

    @cached_property
    def _axes(self) -> FloatArray:
        """Rotation matrix from the axes of the straight arm to the world, shape (d, d)."""
        return np.asarray(self.arm.link_rotations(np.zeros(len(self.arm.coordinates)))[0])

    @cached_property
    def _goal(self) -> tuple[FloatArray, FloatArray | None]:
        """Goal position of the tip in arm lengths from the base, and goal direction or None, both in base axes."""
        position = (self.position - self.arm.base) @ self._axes / self.arm.length
        return position, None if self.direction is None else self.direction @ self._axes

    def _bends(self, q: FloatArray) -> FloatArray:
        """Return the k bends of each joint of a configuration of shape (c,), one row per joint, shape (n, k) [rad]."""
        arm = self.arm
        return q[: len(arm.bend_limits)].reshape(arm.links, arm.bends_a_joint)

    @cached_property
    def _frame_values(self) -> dict[str, FloatArray]:
        """Values at the start pose of the symbols and parameters of the links and what bends them, by name."""
        beside = None if self.roll is None else self.roll.beside @ self._axes
        return self.program.frames.values(self._bends(self.start), self._base(self.start), self._goal[1], beside)

    def _base(self, q: FloatArray) -> FloatArray:
        """Return the positions of the axes that carry the base, with lengths in arm lengths; 0 on a fixed base."""
        return (q[self.arm.coordinates.base] if self.arm.base_axes else np.zeros(1)) / self._base_units

    @cached_property
    def _base_units(self) -> FloatArray:
        """Unit of the position of each axis that carries the base [m, rad]."""
        axes = self.arm.base_axes
        return np.array([1.0 if axis.unit == "rad" else self.arm.length for axis in axes]) if axes else np.ones(1)

    @cached_property
    def parameters(self) -> FloatArray:
        """Values of the program's parameters in one column, shape (parameters,)."""
        length = self.arm.length
        kept_base = {}
        if self.base_weights is not None:
            kept_base = {"near feed": self._base(self.near), "feed weights": self.base_weights}
        numbers = {
            "weights": self.weights,
            "wanted gap": np.array([self.wanted_gap / length]),
            "near": self._bends(self.near),
            **kept_base,
            "first shares": self.arm.free_shares,
            "goal": self._goal[0],
            # A tip that its bounds fix at the goal lies in any ball about it.
            "goal room": np.array([self.room[0] / length or 1.0]),
        }
        loads = self._forces if self.program.size.loaded else {}
        return self.program.parameters.filled(numbers | self._frame_values | self.padded_sides() | loads)

    @cached_property
    def _forces(self) -> dict[str, FloatArray]:
        """Weights of the links (n, d) and the payload (d,), and torque limits, by name of the parameter.

        The limits are those of the bends, shape (n, k), or of the drives, shape (m,).

        Forces are fractions of the total weight, torques fractions of total weight times arm length, in base axes.
        """
        arm = self.arm
        gravity = self.gravity @ self._axes
        whole = float(np.sum(arm.masses) + arm.payload) * float(np.linalg.norm(gravity)) or 1.0
        limits = np.asarray(self.torque_limits)
        # The guide tube carries the links whose joints it holds.
        limits = np.where(self.held, np.inf, limits)
        return {
            "link weights": arm.masses[:, None] * gravity / whole,
            "payload": arm.payload * gravity / whole,
            "torque limits": (limits if arm.drives else self._bends(limits)) / (arm.length * whole),
        }

    def padded_sides(self) -> dict[str, FloatArray]:
        """Return the sides of the regions, padded to an equal number per joint, by name of the parameter.

        Padding sides have a zero normal and an offset for which they always hold.

        Returns:
            Normals, shape (n + 1, sides, d), offsets in arm lengths and gap fractions, shape (n + 1, sides), in base
            axes.
        """
        regions = self.regions
        size = self.program.size
        normals = np.zeros((size.links + 1, size.sides, size.dimension))
        offsets = np.full((size.links + 1, size.sides), -2.0)
        gap_shares = np.zeros((size.links + 1, size.sides))
        place = (regions.joint, regions.number)
        normals[place] = regions.normals @ self._axes
        offsets[place] = (regions.offsets - regions.normals @ self.arm.base) / self.arm.length
        gap_shares[place] = regions.gap_shares
        return {"normals": normals, "offsets": offsets, "gap shares": gap_shares}

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of the program's variables, each of shape (variables,).

        They fix the ends of the curve, limit bends and feed, keep the tip within the goal's tolerances, and cap the gap
        at ``wanted_gap``.
        """
        length = self.arm.length
        frames = self.program.frames
        position, direction = self._goal
        free = np.full((self.arm.links, len(position)), np.inf)
        reach = self.room[0] / length
        low, high = self.base_range
        by_name = {
            **frames.bounds(
                self._frame_values["links"][-1], direction, self.room[1], 0.0 if self.roll is None else self.roll.room
            ),
            frames.bent_by: self.bend_bounds(_LIMIT_SHARE),
            "points": (np.vstack((-free, position - reach)), np.vstack((free, position + reach))),
            "feed": (low / self._base_units, high / self._base_units),
            "gap": (np.array([self._least_gap / length]), np.array([self.wanted_gap / length])),
        }
        lower, upper = ({name: pair[side] for name, pair in by_name.items()} for side in (0, 1))
        unknowns = self.program.unknowns
        return unknowns.filled(lower, -np.inf), unknowns.filled(upper, np.inf)

    @cached_property
    def _start_gap(self) -> float:
        """Least gap of any link to the sides of its region in the start pose [m]; negative if a link is outside."""
        return self.regions.gap(self.arm.free_shares, self.arm.joint_positions_at(self.start))

    @property
    def _least_gap(self) -> float:
        """Lower bound on the gap [m], at most that of a start pose without contact; −∞ if the user has no costs.

        Without the user's costs, the cost of missing clearance outweighs all others, so that no bound is needed.
        """
        if len(self.program.parts) == len(self.weights):
            return -np.inf
        least = _USER_GAP * self.wanted_gap
        return min(least, self._start_gap) if self._start_gap > 0.0 else least

    @cached_property
    def start_values(self) -> FloatArray:
        """Values of the program's variables at the start pose and the curve near that pose, shape (variables,)."""
        arm = self.arm
        points = arm.joint_positions_at(self.start)
        gap = min(self._start_gap, self.wanted_gap)
        numbers = {
            **self._frame_values,
            "points": (points - arm.base) @ self._axes / arm.length,
            "gap": np.array([gap / arm.length]),
        }
        loads = self.program.loads
        if loads is not None:
            unknowns = self.program.unknowns
            names = ("links", "points", "feed", self.program.frames.bent_by)
            known = [*(unknowns[name] for name in names), loads.weights, loads.payload, loads.limits]
            given = [each.T for each in (*(numbers[name] for name in names), *self._forces.values())]
            values = ca.Function("loads", known, list(loads.values()))(*given)
            numbers |= {name: np.asarray(each).T for name, each in zip(loads.symbols, values, strict=True)}
        return self.program.unknowns.filled(numbers)

    def _read(self, answer: Mapping[str, Any], statistics: Mapping[str, Any]) -> ArmPose:
        arm = self.arm
        settings = self.settings
        frames = self.program.frames
        variables = np.asarray(answer["x"], dtype=np.float64).ravel()
        values = {name: variables[place] for name, place in self.program.unknowns.places.items()}
        q = arm.configuration(frames.bends_of(values), values["feed"] * self._base_units)
        q = np.clip(q, arm.lower_limits, arm.upper_limits)
        return ArmPose(
            arm=arm,
            q=q,
            curve=frames.curve(arm, values, q),
            gap=float(values["gap"][0]) * arm.length,
            answer=row_answer(
                self.program,
                answer,
                statistics,
                feasible=settings.feasible,
                costs=self.program.costs(variables, self.parameters, self.weights),
                bounded=self._bend_multipliers(np.asarray(answer["lam_x"], dtype=np.float64).ravel()),
                binding=settings.binding,
            ),
        )

    def _bend_multipliers(self, of_bounds: FloatArray) -> dict[str, float]:
        """Return the Lagrange multipliers of the joint limits by name, such as "joint 3: bend left" or "section2_a".

        ``of_bounds`` are the multipliers of the bounds of all variables, shape (variables,).
        """
        k = self.arm.bends_a_joint
        place = self.program.unknowns.places[self.program.frames.bent_by]
        lower, upper = self.bounds
        free = lower[place] < upper[place]
        found = {}
        for bend in np.flatnonzero(free).tolist():
            multiplier = of_bounds[place][bend]
            if self.arm.drives is not None:
                found[f"{self.arm.drives.drive_names[bend]}: limit"] = float(multiplier)
                continue
            side = _SIDES[bend % k][int(multiplier < 0.0)]
            found[f"joint {bend // k + 1}: bend {side}"] = float(multiplier)
        return found

    @cached_property
    def _bent_by(self) -> _BentBy:
        """What bends the joints: bends of their own, or drives."""
        arm = self.arm
        if arm.drives is None:
            places = np.repeat(arm.bending_places, arm.bends_a_joint)
            return _BentBy(self.start[: len(arm.bend_limits)], arm.bend_limits, places)
        places = arm.drives.least_moved(arm.bending_places)
        return _BentBy(self._frame_values["drives"], arm.drives.drive_limits, places)

    @cached_property
    def held(self) -> BoolArray:
        """Mask of the bends, or of the drives, that the guide tube holds at the start pose."""
        return np.asarray(self._out < -HELD_TOLERANCE)

    @property
    def _out(self) -> FloatArray:
        """How far what has to be out of the guide tube for each bend or drive is out at the start pose, (m,) [m]."""
        fed = 0.0 if self.arm.feed is None else float(self.arm.coordinates.advance(self.start))
        return np.asarray(fed + self._bent_by.places - self.arm.hole)

    def bend_bounds(self, share: float) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper bounds of all bends, or of the drives, each of shape (bends,) [rad].

        Bends of joints inside the guide tube are zero. Just beyond the tube the bounds are small, because a sharp bend
        near the tube would have to be made, or undone, within a short length of feed.

        Args:
            share: fraction of the limits that a pose may use.
        """
        arm = self.arm
        own = self._bent_by
        limits = share * own.limits * bend_shares(arm, self._out)
        # The start may use more of its limits than that.
        limits = np.maximum(limits, np.minimum(np.abs(own.values), own.limits))
        limits[self.held] = 0.0
        lower, upper = -limits, limits
        if self.clamped:
            lower[: arm.bends_a_joint] = upper[: arm.bends_a_joint] = own.values[: arm.bends_a_joint]
        return lower, upper

    @property
    def base_range(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds on the positions of the axes that carry the base, shape (k,) each [m, rad].

        The joints that may bend stay outside a guide tube.
        """
        arm = self.arm
        if not arm.base_axes:
            return np.zeros(1), np.zeros(1)
        low, high = (ends[arm.coordinates.base] for ends in (arm.lower_limits, arm.upper_limits))
        if arm.feed is not None and not np.all(self.held):
            first = float(np.min(self._bent_by.places[~self.held]))
            low = np.minimum(np.maximum(low, arm.hole - first), high)
        return low, high
