"""Solves the goal-pose program in space."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.ipopt_call import ipopt_answer
from ccm_opt.ik.bishop_shooting import chained_quaternions, quaternions_of
from ccm_opt.ik.built_solver import IPOPT_SWITCHES, built_solver
from ccm_opt.ik.holding import holding_loads
from ccm_opt.ik.pose_settings import SpacePoseSettings
from ccm_opt.ik.row_program import RowAnswer, RowReading
from ccm_opt.ik.space_pose_program import SpacePoseProgram
from ccm_opt.ik.space_pose_task import SpacePoseTask
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.curve_space import CurveSpace
from ccm_opt.robot.rigid_motions import exponential
from ccm_opt.robot.segment import PIECES, second_derivatives
from ccm_opt.robot.space_configuration import SpaceConfiguration

_LIMIT_SHARE = 0.98
"""Share of a joint limit that a pose may use (as the steps of the motion have it)."""
_FIRST_BARRIER = 1e-4
"""Where the barrier starts; small, for the start keeps every row (measured: with 1e-2 arms behind holes are lost)."""
_PUSH = 1e-5
"""How far the start is moved off its bounds, relative (measured: with the solver's own hundredth, which is more than
any gap, two of the three shared problems do not converge, with this all do)."""


@dataclass(frozen=True)
class CurveNumbers:
    """A curve of the NLP in numbers; lengths in units of the arm's length.

    Attributes:
        arcs: of the knots, shape (4 K + 1,).
        curvatures: κ1 and κ2 there, shape (2, 4 K + 1).
        base_turn: to the left and upwards, shape (2,) [rad].
    """

    arcs: FloatArray
    curvatures: FloatArray
    base_turn: FloatArray

    @classmethod
    def near(cls, arm: Arm, q: FloatArray, segments: int) -> "CurveNumbers":
        """The curve with even knots whose bends come nearest to those of a pose, shape (c,)."""
        knots = PIECES * segments + 1
        space = CurveSpace.of(arm, knots)
        v = space.nearest(q)
        curvatures = (space.curvature_rows @ v).reshape(2, knots) * arm.length
        turns = (v * space.scales)[[0, knots + 1]]
        return cls(np.linspace(0.0, 1.0, knots), curvatures, turns)

    @property
    def segments(self) -> int:
        """Number of curvature segments K."""
        return (len(self.arcs) - 1) // PIECES

    def segment_values(self) -> tuple[list[float], list[FloatArray], list[tuple[float, float, float]]]:
        """Lengths, curvatures (5, 2) and inner knots of the segments."""
        lengths = []
        values = []
        shares = []
        for segment in range(self.segments):
            inside = slice(PIECES * segment, PIECES * (segment + 1) + 1)
            arcs = self.arcs[inside]
            lengths.append(float(arcs[-1] - arcs[0]))
            values.append(self.curvatures[:, inside].T.copy())
            inner = (arcs[1:-1] - arcs[0]) / lengths[-1]
            shares.append((float(inner[0]), float(inner[1]), float(inner[2])))
        return lengths, values, shares

    def configuration(self, arm: Arm, feed: float) -> SpaceConfiguration:
        """The curve in metres, from where the base is carried so far [m]."""
        lengths, values, shares = self.segment_values()
        rotation, _ = exponential(np.array([0.0, -self.base_turn[1], self.base_turn[0], 0.0, 0.0, 0.0]))
        return SpaceConfiguration.chain(
            arm.base + feed * arm.direction,
            arm.base_rotation @ rotation,
            [arm.length * length for length in lengths],
            [value / arm.length for value in values],
            shares,
        )

    def link_turns(self, links: int) -> tuple[FloatArray, FloatArray]:
        """Ω and ψ of every link, as ``BishopShooting`` has them, each of shape (n, 2) [rad]."""
        joints = np.linspace(0.0, 1.0, links + 1)
        turns = np.zeros((links, 2))
        means = np.zeros((links, 2))
        for index in (0, 1):
            flat = self.planar(index)
            at_joints = flat.heading_at(joints)
            turns[:, index] = np.diff(at_joints)
            means[:, index] = np.diff(flat.heading_integral_at(joints)) * links - at_joints[:-1]
        return turns, means

    def directions(self, links: int) -> FloatArray:
        """Mean directions over the links, in the axes of the base, as ``BishopShooting`` has them, shape (n, 3)."""
        turns, means = self.link_turns(links)
        size = np.linalg.norm(means, axis=1)
        local = np.concatenate((np.cos(size)[:, None], np.sinc(size / np.pi)[:, None] * means), axis=1)
        frames = _curve_frames(self.base_turn, turns, means)
        # q v q̄ = v + 2 w (u × v) + 2 u × (u × v) with q = (w, u)
        vector = frames[:, 1:]
        crossed = np.cross(vector, local)
        return np.asarray(local + 2.0 * (frames[:, :1] * crossed + np.cross(vector, crossed)))

    def planar(self, index: int) -> Configuration:
        """The curve of the plane with one of the curvatures, whose headings are its turns."""
        lengths, values, shares = self.segment_values()
        return Configuration.chain(np.zeros(2), 0.0, lengths, [value[:, index] for value in values], shares)


def start_values(arm: Arm, q: FloatArray, curve: CurveNumbers, moment_scale: float) -> FloatArray:
    """Values of the first variables, up to the feed, in the order of ``SpacePoseProgram.variables``.

    Args:
        arm: the arm.
        q: the pose, shape (c,).
        curve: near it.
        moment_scale: of ``LiftedCurve``.
    """
    values = [curve.arcs]
    turns, means = curve.link_turns(arm.links)
    lengths, of_segments, shares = curve.segment_values()
    widths = [length * np.diff([0.0, *inner, 1.0]) for length, inner in zip(lengths, shares, strict=True)]
    for index in (0, 1):
        flat = curve.planar(index)
        values += [curve.curvatures[index], flat.heading_at(curve.arcs), flat.heading_integral_at(curve.arcs)]
        pairs = zip(widths, of_segments, strict=True)
        moments = [second_derivatives(width, value[:, index])[1:-1] for width, value in pairs]
        values.append(np.concatenate(moments) / moment_scale)
    values += [curve.base_turn, turns.ravel(), means.ravel(), _curve_frames(curve.base_turn, turns, means).ravel()]
    bends = arm.bend_pairs(q)
    points = (arm.joint_positions_at(q) - arm.base) @ arm.base_rotation / arm.length
    feed = arm.coordinates.advance(q) / arm.length
    return np.concatenate((*values, bends.ravel(), link_quaternions(bends).ravel(), points.ravel(), [feed]))


def link_quaternions(bends: FloatArray) -> FloatArray:
    """Quaternions of links turned by bends, shape (n, 2) to (n, 4)."""
    zero = np.zeros(len(bends))
    about_z = quaternions_of(np.column_stack((zero, zero, bends[:, 0])))
    about_y = quaternions_of(np.column_stack((zero, bends[:, 1], zero)))
    return chained_quaternions(np.stack((about_z, about_y), axis=1).reshape(-1, 4))[1::2]


def _curve_frames(base_turn: FloatArray, turns: FloatArray, means: FloatArray) -> FloatArray:
    """Frames at the beginnings of the links, as ``BishopShooting`` has them, shape (n, 4)."""
    roll = means[:, 0] * turns[:, 1] - means[:, 1] * turns[:, 0]
    steps = np.column_stack((roll, -turns[:, 1], turns[:, 0]))[:-1]
    first = np.array([[0.0, -base_turn[1], base_turn[0]]])
    return chained_quaternions(quaternions_of(np.concatenate((first, steps))))


_SWITCHES: dict[str, Any] = {
    **IPOPT_SWITCHES,
    "calc_lam_p": False,
    "no_nlp_grad": True,
    # From a start that keeps every row the barrier has only to fall.
    "ipopt.mu_strategy": "monotone",
    # What the links' chain leaves open adds up along the arm.
    "ipopt.constr_viol_tol": 1e-10,
}
_PUSHES = ("ipopt.bound_push", "ipopt.bound_frac", "ipopt.slack_bound_push", "ipopt.slack_bound_frac")


@dataclass(frozen=True, eq=False)
class SpaceArmPose:
    """What the goal-pose NLP found.

    Attributes:
        q: the configuration, shape (c,) [rad, m].
        curve: the curve whose mean directions its links have.
        gap: least room of any link in its region beyond radius and clearance, at most the wanted gap [m].
        answer: how the program was answered.
    """

    q: FloatArray
    curve: SpaceConfiguration
    gap: float
    answer: RowAnswer

    @property
    def at(self) -> FloatArray:
        """The configuration."""
        return self.q


@dataclass(frozen=True, eq=False)
class SpacePoseQuestion:
    """A task put to a program.

    Attributes:
        program: symbols, perhaps with user terms.
        task: the numbers.
        weights: of the parts of the objective, in the order of ``SPACE_PARTS``, shape (7,).
        settings: of the solver.
    """

    program: SpacePoseProgram
    task: SpacePoseTask
    weights: FloatArray
    settings: SpacePoseSettings

    def solve(self) -> SpaceArmPose:
        """Solve from the task's start; never raises on failure, the result says how it went.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed meanwhile.
        """
        lower, upper = self._variable_bounds()
        row_lower, row_upper = self.program.bounds
        start = np.clip(self._start(), lower, upper)
        bounds = {"lbx": lower, "ubx": upper, "lbg": row_lower, "ubg": row_upper}
        solver = partial(built_solver, self.program, _options(self.settings))
        return self._read(*ipopt_answer(solver, start, p=self._parameters(), **bounds))

    @cached_property
    def _length(self) -> float:
        return self.task.arm.length

    @cached_property
    def _rotation(self) -> FloatArray:
        """From the axes of the base to the world."""
        return self.task.arm.base_rotation

    @cached_property
    def _across(self) -> FloatArray:
        """Two unit vectors across the goal's direction, in the axes of the base, shape (3, 2)."""
        direction = self.task.target.direction
        along = np.array([1.0, 0.0, 0.0]) if direction is None else self._rotation.T @ direction
        return np.asarray(np.linalg.svd(along[None])[2][1:].T)

    @cached_property
    def _goal(self) -> FloatArray:
        return np.asarray((self.task.target.position - self.task.arm.base) @ self._rotation / self._length)

    def _parameters(self) -> FloatArray:
        """Numbers for ``SpacePoseParameters.column``."""
        task = self.task
        size = self.program.size
        normals, offsets, gap_shares = self._padded_sides()
        values: list[FloatArray | list[float]] = [
            self.weights,
            [task.wanted_gap / self._length],
            task.arm.bend_pairs(task.near).ravel(),
            task.first_shares,
            self._goal,
            # A tip that is held at its goal by its bounds lies in any ball about it.
            [task.room[0] / self._length or 1.0],
            self._across.T.ravel(),
            normals.reshape(size.links * size.sides, 3).ravel(),
            offsets.ravel(),
            gap_shares.ravel(),
            self._offsets_from_curve.ravel(),
        ]
        if size.loaded:
            weights, payload, limits = self._weights
            values += [weights.ravel(), payload, limits.ravel()]
        return np.concatenate(values)

    @cached_property
    def _weights(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Forces on the links (n, 3) and on the tip (3,), and limits of the torques (n, 2), as shares of all weight."""
        task = self.task
        gravity = task.gravity @ self._rotation
        whole = float(np.sum(task.arm.masses) + task.arm.payload) * float(np.linalg.norm(gravity)) or 1.0
        limits = np.asarray(task.torque_limits).reshape(-1, 2)
        # The guide tube carries the links whose joints it holds.
        held = np.arange(len(limits)) < task.first_bending
        limits = np.where(held[:, None], np.inf, limits) / (self._length * whole)
        return task.arm.masses[:, None] * gravity / whole, task.arm.payload * gravity / whole, limits

    @cached_property
    def _offsets_from_curve(self) -> FloatArray:
        """What the links of the start have of the mean directions of the curve near it, shape (n, 2).

        With them the start keeps every row. The pose may lose them, but need not: so it is with the coordinates of
        motions, whose offset from the curve stays all the way.
        """
        task = self.task
        links = task.arm.link_rotations(task.start)
        means = self._near.directions(task.arm.links) @ self._rotation.T
        return np.asarray(np.einsum("nij,ni->nj", links[:, :, 1:], means))

    def _padded_sides(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Normals (n, sides, 3), offsets and shares of the gap (n, sides) in the axes of the base.

        Sides that say nothing have no normal, and an offset that is always kept.
        """
        task = self.task
        size = self.program.size
        normals = np.zeros((size.links, size.sides, 3))
        offsets = np.full((size.links, size.sides), -1.0)
        gap_shares = np.zeros((size.links, size.sides))
        order = np.argsort(task.sides.link, kind="stable")
        links = task.sides.link[order]
        place = np.arange(len(links)) - np.searchsorted(links, links)
        normals[links, place] = task.sides.normals[order] @ self._rotation
        from_base = task.sides.offsets[order] - task.sides.normals[order] @ task.arm.base
        offsets[links, place] = from_base / self._length
        gap_shares[links, place] = task.sides.gap_shares[order]
        return normals, offsets, gap_shares

    def _variable_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the variables: the ends of the curve, the limits of the joints, the goal and the gap."""
        program = self.program
        task = self.task
        places = program.places
        upper = np.full(program.variables.numel(), np.inf)
        lower = -upper
        lower[places["arcs"]][[0, -1]] = upper[places["arcs"]][[0, -1]] = (0.0, 1.0)
        for name in ("turned left", "integral left", "turned up", "integral up"):
            lower[places[name].start] = upper[places[name].start] = 0.0
        limits = task.bend_limits(_LIMIT_SHARE)
        lower[places["bends"]] = -limits
        upper[places["bends"]] = limits
        low, high = task.feed_range
        lower[places["feed"]] = low / self._length
        upper[places["feed"]] = high / self._length
        tip = slice(places["points"].stop - 3, places["points"].stop)
        lower[tip] = self._goal - task.room[0] / self._length
        upper[tip] = self._goal + task.room[0] / self._length
        if task.target.direction is not None:
            # The square inside the cone's section, so that its corners are within the tolerance too.
            most = np.sin(task.room[1]) / np.sqrt(2.0)
            lower[places["tip parts"]] = -most
            upper[places["tip parts"]] = most
        lower[places["stray"]] = 0.0
        upper[places["stray"]] = 1.0
        upper[places["gap"]] = task.wanted_gap / self._length
        return lower, upper

    @cached_property
    def _near(self) -> CurveNumbers:
        """The curve whose bends come nearest to those of the start."""
        return CurveNumbers.near(self.task.arm, self.task.start, self.program.size.segments)

    def _start(self) -> FloatArray:
        task = self.task
        scale = self.program.curve.parts[0].moment_scale
        values = start_values(task.arm, task.start, self._near, scale)
        last = task.arm.link_rotations(task.start)[-1, :, 0] @ self._rotation
        gap = min(task.sides.gap(task.first_shares, task.arm.joint_positions_at(task.start)), task.wanted_gap)
        return np.concatenate((values, self._across.T @ last, [1.0], self._loads(), [gap / self._length]))

    def _loads(self) -> FloatArray:
        """What gravity asks of the joints in the pose to start from; nothing where torque is not limited."""
        if not self.program.size.loaded:
            return np.zeros(0)
        arm = self.task.arm
        weights, payload, limits = self._weights
        points = (arm.joint_positions_at(self.task.start) - arm.base) @ self._rotation / self._length
        moments, torques = holding_loads(link_quaternions(arm.bend_pairs(self.task.start)), points, weights, payload)
        return np.concatenate((moments.ravel(), (torques / limits).ravel()))

    def _read(self, answer: Mapping[str, Any], statistics: Mapping[str, Any]) -> SpaceArmPose:
        program = self.program
        task = self.task
        reading = RowReading(program, answer, statistics)
        variables = reading.variables
        costs = program.costs(variables, self._parameters(), self.weights)
        bends = variables[program.places["bends"]]
        q = task.arm.configuration(bends, float(variables[program.places["feed"]][0]) * self._length)
        q = np.clip(q, task.arm.lower_limits, task.arm.upper_limits)
        return SpaceArmPose(
            q=q,
            curve=self._curve(variables),
            gap=float(variables[-1]) * self._length,
            answer=reading.says(costs, binding=self.settings.binding, feasible=self.settings.feasible),
        )

    def _curve(self, variables: FloatArray) -> SpaceConfiguration:
        """The curve of a solution, in metres, from where the base is."""
        places = self.program.places
        arcs = variables[places["arcs"]]
        if np.any(np.diff(arcs) <= 0.0):  # where the solver failed, knots may lie out of their order
            arcs = np.linspace(0.0, 1.0, len(arcs))
        curvatures = np.stack((variables[places["curvature left"]], variables[places["curvature up"]]))
        turn = variables[places["base turn"]]
        feed = float(variables[places["feed"]][0]) * self._length
        return CurveNumbers(arcs, curvatures, turn).configuration(self.task.arm, feed)


def _options(settings: SpacePoseSettings) -> dict[str, Any]:
    """The settings in IPOPT's names."""
    return {
        **_SWITCHES,
        "ipopt.max_iter": settings.iterations,
        "ipopt.tol": settings.tolerance,
        "ipopt.mu_init": _FIRST_BARRIER,
        **dict.fromkeys(_PUSHES, _PUSH),
    }
