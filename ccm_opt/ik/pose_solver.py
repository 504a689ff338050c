"""Solves the goal-pose program in the plane."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.ipopt_call import ipopt_answer
from ccm_opt.ik.built_solver import IPOPT_SWITCHES, built_solver
from ccm_opt.ik.pose_program import PoseProgram
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.row_program import RowAnswer, RowReading
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.segment import PIECES, second_derivatives

_LIMIT_SHARE = 0.98
"""Share of a joint limit that a pose may use (as the steps of the motion have it)."""
_FIRST_BARRIER = 1e-2
"""Where the barrier starts; small, for a pose of the arm is known (taste)."""


def held_points(first_shares: FloatArray, points: FloatArray) -> FloatArray:
    """The points that regions hold: where the free part of every link begins, and the tip, shape (links + 1, 2) [m].

    Args:
        first_shares: of the arm, shape (links,).
        points: joint and tip positions, shape (links + 1, 2) [m].
    """
    starts = points[:-1] + first_shares[:, None] * np.diff(points, axis=0)
    return np.vstack((starts, points[-1:]))


@dataclass(frozen=True, eq=False)
class JointRegions:
    """A convex region for every joint and the tip, for the arm's axis: n · x ≤ b.

    A link has a convex region, in which both its ends lie, and so all of it does; a joint lies in the regions of both
    its links. Walls, and other links that must be kept apart, are behind the sides already by the radius and the
    clearance; what a link has beyond that is its gap.

    Attributes:
        normals: unit, outwards, shape (links + 1, sides, 2); rows that say nothing are zero.
        offsets: shape (links + 1, sides) [m]; where the normal is zero, anything positive.
    """

    normals: FloatArray
    offsets: FloatArray

    @property
    def sides(self) -> int:
        """Most sides of any region."""
        return int(self.offsets.shape[1])

    def gap(self, first_shares: FloatArray, points: FloatArray) -> float:
        """Least distance of any held point inside its region [m]; arguments as of ``held_points``."""
        places = held_points(first_shares, points)
        inside = self.offsets - np.einsum("jd,jsd->js", places, self.normals)
        return float(np.min(inside[np.any(self.normals != 0.0, axis=2)], initial=np.inf))


@dataclass(frozen=True, eq=False)
class PoseTask:
    """One question to the goal-pose NLP.

    Attributes:
        arm: whose pose it is.
        position: where the tip has to be, shape (2,) [m].
        heading: where the last link points, whole turns included [rad], or None.
        room: by how much the tip [m] and the last link [rad] may miss these two; then any member of the set will do.
        near: link headings of a pose to stay near, shape (links,) [rad].
        start: link headings of the pose that the solver starts from, shape (links,) [rad]; usually in its regions.
        regions: a convex region for every joint and the tip.
        wanted_gap: room beyond radius and clearance above which more room is worth nothing [m].
        clamped: whether the first link keeps its heading.
        gravity: in the plane of the arm, shape (2,) [m/s²].
        torque_limits: of each bend's drive, shape (links,) [N m]; infinite where torque is not limited.
    """

    arm: Arm
    position: FloatArray
    heading: float | None
    near: FloatArray
    start: FloatArray
    regions: JointRegions
    wanted_gap: float
    clamped: bool = False
    room: tuple[float, float] = (0.0, 0.0)
    gravity: FloatArray = field(default_factory=lambda: np.zeros(2))
    torque_limits: FloatArray | None = None


_SWITCHES: dict[str, Any] = {
    **IPOPT_SWITCHES,
    # Nobody asks how the optimum depends on the parameters; the gradient for it would take a quarter of the building.
    "calc_lam_p": False,
    "no_nlp_grad": True,
    # What the links' chain leaves open adds up along the arm, to 200 times as much at the tip.
    "ipopt.constr_viol_tol": 1e-10,
}


@dataclass(frozen=True, eq=False)
class ArmPose:
    """What the goal-pose NLP found.

    Attributes:
        headings: of the links, shape (links,) [rad].
        curve: the curve whose mean headings they are.
        gap: least room of any link in its region beyond radius and clearance, at most the wanted gap [m].
        answer: how the program was answered.
    """

    headings: FloatArray
    curve: Configuration
    gap: float
    answer: RowAnswer

    @property
    def at(self) -> FloatArray:
        """The headings."""
        return self.headings


@dataclass(frozen=True, eq=False)
class PoseQuestion:
    """A task put to a program.

    Attributes:
        program: symbols, perhaps with user terms.
        task: the numbers.
        weights: of the parts of the objective, in the order of ``PARTS``.
        settings: of the solver.
    """

    program: PoseProgram
    task: PoseTask
    weights: FloatArray
    settings: PoseSettings

    def solve(self, curve: Configuration) -> ArmPose:
        """Solve from the task's start and a curve near it; never raises on failure, the result says how it went.

        Args:
            curve: with as many segments as the program's, for the start.

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed meanwhile.
        """
        lower, upper = self._variable_bounds()
        row_lower, row_upper = self.program.bounds
        start = np.clip(self._start(curve), lower, upper)
        bounds = {"lbx": lower, "ubx": upper, "lbg": row_lower, "ubg": row_upper}
        solver = partial(built_solver, self.program, _options(self.settings))
        return self._read(*ipopt_answer(solver, start, p=self._parameters(), **bounds))

    @cached_property
    def _length(self) -> float:
        return self.task.arm.length

    def _parameters(self) -> FloatArray:
        """Numbers for ``PoseParameters.column``."""
        task = self.task
        arm = task.arm
        offsets = (task.regions.offsets - task.regions.normals @ arm.base) / self._length
        limits = _LIMIT_SHARE * arm.bend_limits
        if task.clamped:
            limits[0] = max(limits[0], abs(float(arm.bends(task.start)[0])))
        values: list[FloatArray | list[float]] = [
            self.weights,
            [task.wanted_gap / self._length],
            task.near,
            [arm.base_heading],
            limits,
            arm.free_shares,
            (task.position - arm.base) / self._length,
            # A tip that is held at its goal by its bounds lies in any disc about it.
            [task.room[0] / self._length or 1.0],
            task.regions.normals.reshape(-1),
            offsets.reshape(-1),
        ]
        if self.program.size.loaded and task.torque_limits is not None:
            forces = arm.masses[:, None] * task.gravity
            values += [forces.reshape(-1), arm.payload * task.gravity, task.torque_limits / self._length]
        return np.concatenate(values)

    def _variable_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the variables: the ends of the curve, the base, the goal and the gap are held by them."""
        program = self.program
        task = self.task
        knots = program.curve.count + 1
        curve_size = program.curve.variables.numel()
        upper = np.full(program.variables.numel(), np.inf)
        lower = -upper
        lower[0] = upper[0] = 0.0
        lower[knots - 1] = upper[knots - 1] = 1.0
        first_integral = 3 * knots
        lower[first_integral] = upper[first_integral] = 0.0
        links = program.size.links
        headings = slice(curve_size, curve_size + links)
        points = slice(curve_size + links, curve_size + links + 2 * (links + 1))
        if task.clamped:
            lower[headings.start] = upper[headings.start] = task.start[0]
        if task.heading is not None:
            lower[headings.stop - 1] = task.heading - task.room[1]
            upper[headings.stop - 1] = task.heading + task.room[1]
        lower[points.start : points.start + 2] = upper[points.start : points.start + 2] = 0.0
        goal = (task.position - task.arm.base) / self._length
        lower[points.stop - 2 : points.stop] = goal - task.room[0] / self._length
        upper[points.stop - 2 : points.stop] = goal + task.room[0] / self._length
        upper[-1] = task.wanted_gap / self._length
        return lower, upper

    def _start(self, curve: Configuration) -> FloatArray:
        """Values of the variables at the pose to start from and the curve near it."""
        task = self.task
        arcs = curve.breakpoints / self._length
        widths = np.diff(arcs).reshape(-1, PIECES)
        values = np.array([segment.curvature for segment in curve.segments]) * self._length
        curvatures = np.append(values[:, :-1].ravel(), values[-1, -1])
        moments = [second_derivatives(*pair)[1:-1] for pair in zip(widths, values, strict=True)]
        bows = np.concatenate(moments) / self.program.curve.moment_scale
        headings = curve.heading_at(curve.breakpoints)
        integrals = curve.heading_integral_at(curve.breakpoints) / self._length
        points = task.arm.joint_positions(task.start)
        gap = min(task.regions.gap(task.arm.free_shares, points), task.wanted_gap) / self._length
        from_base = (points - task.arm.base) / self._length
        knots = (arcs, curvatures, headings, integrals, bows)
        return np.concatenate((*knots, task.start, from_base.ravel(), [gap]))

    def _read(self, answer: Mapping[str, Any], statistics: Mapping[str, Any]) -> ArmPose:
        reading = RowReading(self.program, answer, statistics)
        variables = reading.variables
        costs = self.program.costs(variables, self._parameters(), self.weights)
        curve_size = self.program.curve.variables.numel()
        return ArmPose(
            headings=variables[curve_size : curve_size + self.program.size.links],
            curve=self._curve(variables[:curve_size]),
            gap=float(variables[-1]) * self._length,
            answer=reading.says(costs, binding=self.settings.binding, feasible=self.settings.feasible),
        )

    def _curve(self, variables: FloatArray) -> Configuration:
        knots = self.program.curve.count + 1
        arcs = variables[:knots] * self._length
        if np.any(np.diff(arcs) <= 0.0):  # where the solver failed, knots may lie out of their order
            arcs = np.linspace(0.0, self._length, knots)
        curvatures = variables[knots : 2 * knots] / self._length
        lengths = []
        values = []
        shares = []
        for segment in range(self.program.size.segments):
            inside = slice(PIECES * segment, PIECES * (segment + 1) + 1)
            lengths.append(float(arcs[inside][-1] - arcs[inside][0]))
            values.append(curvatures[inside])
            inner = (arcs[inside][1:-1] - arcs[inside][0]) / lengths[-1]
            shares.append((float(inner[0]), float(inner[1]), float(inner[2])))
        return Configuration.chain(self.task.arm.base, float(variables[2 * knots]), lengths, values, shares)


def _options(settings: PoseSettings) -> dict[str, Any]:
    """The settings in IPOPT's names."""
    return {
        **_SWITCHES,
        "ipopt.max_iter": settings.iterations,
        "ipopt.tol": settings.tolerance,
        "ipopt.mu_init": _FIRST_BARRIER,
    }
