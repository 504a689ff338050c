"""Solves the goal-pose program."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.ipopt_call import ipopt_answer
from ccm_opt.ik.curve_frames import CurveNumbers
from ccm_opt.ik.pose_program import PoseProgram
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.pose_task import PoseTask
from ccm_opt.ik.row_program import IPOPT_SWITCHES, RowAnswer, built_solver, row_answer
from ccm_opt.robot.arm import Arm

_LIMIT_SHARE = 0.98
"""Share of a joint limit that a pose may use (as the steps of the motion have it)."""
_SIDES = (("left", "right"), ("down", "up"))
"""Where joints bend to by positive and by negative bends."""


@dataclass(frozen=True, eq=False)
class ArmPose:
    """What the goal-pose NLP found.

    Attributes:
        arm: whose pose it is.
        q: the configuration, shape (c,) [rad, m].
        curve: the curve whose mean directions its links have, of the plane or of space.
        gap: least room of any link in its region beyond radius and clearance, at most the wanted gap [m].
        answer: how the program was answered.
    """

    arm: Arm
    q: FloatArray
    curve: Any
    gap: float
    answer: RowAnswer

    @cached_property
    def headings(self) -> FloatArray:
        """Of the links in the plane, shape (links,) [rad]."""
        return self.arm.headings(self.q[: self.arm.links])


_SWITCHES: dict[str, Any] = {
    **IPOPT_SWITCHES,
    # Nobody asks how the optimum depends on the parameters; the gradient for it would take a quarter of the building.
    "calc_lam_p": False,
    "no_nlp_grad": True,
    # What the links' chain leaves open adds up along the arm, to 200 times as much at the tip.
    "ipopt.constr_viol_tol": 1e-10,
}
_FROM_KEPT_ROWS: dict[str, Any] = {
    # From a start that keeps every row the barrier has only to fall.
    "ipopt.mu_strategy": "monotone",
    # Small (measured: with 1e-2 arms behind holes are lost).
    "ipopt.mu_init": 1e-4,
    # How far the start is moved off its bounds, relative (measured: with the solver's own hundredth, which is more than
    # any gap, two of the three shared problems do not converge, with this all do).
    **dict.fromkeys(("ipopt.bound_push", "ipopt.bound_frac", "ipopt.slack_bound_push", "ipopt.slack_bound_frac"), 1e-5),
}
_FROM_NEAR: dict[str, Any] = {"ipopt.mu_init": 1e-2}
"""Where the barrier starts; small, for a pose of the arm is known (taste; measured: with those above clutter takes a
sixth more iterations)."""


@dataclass(frozen=True, eq=False)
class PoseQuestion:
    """A task put to a program.

    Attributes:
        program: symbols, perhaps with user terms.
        task: the numbers.
        weights: of the parts of the objective by name.
        settings: of the solver.
    """

    program: PoseProgram
    task: PoseTask
    settings: PoseSettings
    weights: FloatArray

    def solve(self) -> ArmPose:
        """Solve from the task's start; never raises on failure, the result says how it went.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed meanwhile.
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
        solver = partial(built_solver, self.program, options)
        answer, statistics = ipopt_answer(solver, np.clip(self.start, lower, upper), p=self.parameters, **bounds)
        return self._read(answer, statistics)

    @cached_property
    def _axes(self) -> FloatArray:
        """From the axes of the base to the world, shape (d, d)."""
        return np.asarray(self.task.arm.link_rotations(np.zeros(len(self.task.arm.coordinates)))[0])

    @cached_property
    def _goal(self) -> tuple[FloatArray, FloatArray | None]:
        """Where the tip has to be, and where it has to point if that is asked, in the axes of the base."""
        task = self.task
        position = (task.position - task.arm.base) @ self._axes / task.arm.length
        return position, None if task.direction is None else task.direction @ self._axes

    def _bends(self, q: FloatArray) -> FloatArray:
        """Bends of a configuration, a joint a row, shape (n, k) [rad]."""
        arm = self.task.arm
        return q[: len(arm.bend_limits)].reshape(arm.links, arm.bends_a_joint)

    @cached_property
    def _lies(self) -> FloatArray:
        """How the links of the pose to start from lie."""
        return self.program.frames.lies_at(self._bends(self.task.start))

    @cached_property
    def near(self) -> CurveNumbers:
        """The curve whose bends come nearest to those of the start."""
        turns = self.program.frames.turns_of(self._bends(self.task.start))
        return CurveNumbers.near(turns, self.program.size.segments)

    @cached_property
    def _of_frames(self) -> dict[str, FloatArray]:
        """Numbers of the symbols that the frames bring, variables and parameters."""
        return self.program.frames.values(self.near, self._lies, self._goal[1])

    @cached_property
    def parameters(self) -> FloatArray:
        """Numbers for the parameters."""
        task = self.task
        length = task.arm.length
        numbers = {
            "weights": self.weights,
            "wanted gap": np.array([task.wanted_gap / length]),
            "near": self._bends(task.near),
            "first shares": task.arm.free_shares,
            "goal": self._goal[0],
            # A tip that is held at its goal by its bounds lies in any ball about it.
            "goal room": np.array([task.room[0] / length or 1.0]),
        }
        loads = self._forces if self.program.size.loaded else {}
        return self.program.parameters.filled(numbers | self._of_frames | self.padded_sides() | loads)

    @cached_property
    def _forces(self) -> dict[str, FloatArray]:
        """Forces on the links (n, d) and on the tip (d,), and limits of the torques (n, k), as shares of all weight."""
        task = self.task
        arm = task.arm
        gravity = task.gravity @ self._axes
        whole = float(np.sum(arm.masses) + arm.payload) * float(np.linalg.norm(gravity)) or 1.0
        limits = self._bends(np.asarray(task.torque_limits))
        # The guide tube carries the links whose joints it holds.
        held = np.arange(len(limits)) < task.first_bending
        return {
            "link weights": arm.masses[:, None] * gravity / whole,
            "payload": arm.payload * gravity / whole,
            "torque limits": np.where(held[:, None], np.inf, limits) / (arm.length * whole),
        }

    def padded_sides(self) -> dict[str, FloatArray]:
        """Normals (n + 1, sides, d), offsets and shares of the gap (n + 1, sides) in the axes of the base.

        Sides that say nothing have no normal, and an offset that is always kept.
        """
        task = self.task
        regions = task.regions
        size = self.program.size
        normals = np.zeros((size.links + 1, size.sides, size.dimension))
        offsets = np.full((size.links + 1, size.sides), -2.0)
        gap_shares = np.zeros((size.links + 1, size.sides))
        place = (regions.joint, regions.number)
        normals[place] = regions.normals @ self._axes
        offsets[place] = (regions.offsets - regions.normals @ task.arm.base) / task.arm.length
        gap_shares[place] = regions.gap_shares
        return {"normals": normals, "offsets": offsets, "gap shares": gap_shares}

    @cached_property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the variables: the ends of the curve, the limits of the joints, the goal and the gap."""
        task = self.task
        length = task.arm.length
        frames = self.program.frames
        position, direction = self._goal
        free = np.full((task.arm.links, len(position)), np.inf)
        reach = task.room[0] / length
        low, high = task.feed_range
        by_name = {
            **frames.curve_bounds(),
            **frames.bounds(self._lies, direction, task.room[1]),
            "bends": task.bend_bounds(_LIMIT_SHARE),
            "points": (np.vstack((-free, position - reach)), np.vstack((free, position + reach))),
            "feed": (np.array([low / length]), np.array([high / length])),
            "gap": (np.array([-np.inf]), np.array([task.wanted_gap / length])),
        }
        lower, upper = ({name: pair[side] for name, pair in by_name.items()} for side in (0, 1))
        unknowns = self.program.unknowns
        return unknowns.filled(lower, -np.inf), unknowns.filled(upper, np.inf)

    @cached_property
    def start(self) -> FloatArray:
        """Values of the variables at the pose to start from and the curve near it."""
        task = self.task
        arm = task.arm
        points = arm.joint_positions_at(task.start)
        gap = min(task.regions.gap(arm.free_shares, points), task.wanted_gap)
        numbers = {
            **self.program.frames.curve_values(self.near),
            **self._of_frames,
            "bends": task.start[: len(arm.bend_limits)],
            "links": self._lies,
            "points": (points - arm.base) @ self._axes / arm.length,
            "feed": np.array([arm.coordinates.advance(task.start) / arm.length]),
            "gap": np.array([gap / arm.length]),
        }
        loads = self.program.loads
        if loads is not None:
            unknowns = self.program.unknowns
            known = [unknowns["links"], unknowns["points"], loads.weights, loads.payload, loads.limits]
            given = [numbers["links"].T, numbers["points"].T, *(each.T for each in self._forces.values())]
            values = ca.Function("loads", known, list(loads.values()))(*given)
            numbers |= {name: np.asarray(each).T for name, each in zip(loads.symbols, values, strict=True)}
        return self.program.unknowns.filled(numbers)

    def _read(self, answer: Mapping[str, Any], statistics: Mapping[str, Any]) -> ArmPose:
        arm = self.task.arm
        settings = self.settings
        frames = self.program.frames
        variables = np.asarray(answer["x"], dtype=np.float64).ravel()
        values = {name: variables[place] for name, place in self.program.unknowns.places.items()}
        feed = float(values["feed"][0]) * arm.length
        return ArmPose(
            arm=arm,
            q=np.clip(arm.configuration(values["bends"], feed), arm.lower_limits, arm.upper_limits),
            curve=frames.curve(arm, frames.numbers(values), feed),
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
        """What the limits of the bends cost, by the joint and the side that it bends to."""
        k = self.task.arm.bends_a_joint
        place = self.program.unknowns.places["bends"]
        lower, upper = self.bounds
        free = lower[place] < upper[place]
        found = {}
        for bend in np.flatnonzero(free).tolist():
            multiplier = of_bounds[place][bend]
            side = _SIDES[bend % k][int(multiplier < 0.0)]
            found[f"joint {bend // k + 1}: bend {side}"] = float(multiplier)
        return found
