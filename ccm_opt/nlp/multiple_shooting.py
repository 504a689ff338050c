"""The configuration NLP as data: symbols and named rows, built once a size; bounds and parameters, per task."""

from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.freespace.corridor import ConvexRegion
from ccm_opt.nlp import constraints
from ccm_opt.nlp.configuration_task import END_TOLERANCE, ConfigurationTask
from ccm_opt.nlp.costs import configuration_cost, nearness
from ccm_opt.nlp.curve_ode import CONTROLS, PIECES, STATES, SegmentFlow, segment_function

STAGE = STATES + CONTROLS
LEAST_PIECE = 4e-3
"""Least arc length between knots, in units of the arm's length."""
LEAST_SPACING = 0.08
"""Least share of its segment that a piece keeps while knots are free."""
SHRINK = 1e-5
"""Regions shrink by this in units of the arm's length, so that quadrature and polish stay inside the real ones."""
CURVATURE_RESERVE = 1e-3
"""Share of the curvature limit kept for the polish."""
_ROW_SIZES = (4, 6, 8, 12, 16, 24, 32, 48, 64)


@dataclass(frozen=True, eq=False)
class Program:
    """The symbolic part, shared by all tasks of one size.

    Attributes:
        segments: number of curvature segments.
        half_planes: rows kept for each segment's region; unused ones are padded.
        variables: X_0, U_0, X_1, U_1, .., X_K in one column.
        parameters: a column: normals, offsets of each segment, knot fraction, stub length,
            weight of the bending.
        objective: scalar.
        constraints: one column, ``lower <= constraints <= upper``.
        row_names: what each row says.
        lower: shape (rows,).
        upper: shape (rows,).
    """

    segments: int
    half_planes: int
    variables: ca.SX
    parameters: ca.SX
    objective: ca.SX
    constraints: ca.SX
    row_names: tuple[str, ...]
    lower: FloatArray
    upper: FloatArray


@dataclass(frozen=True, eq=False)
class ConfigurationNLP:
    """One task's NLP: a program with its numbers. Lengths are in units of the arm's, the base is the origin.

    Attributes:
        task: the question it answers.
        program: the symbolic part.
        regions: index of the corridor's region for each segment.
        tip_heading: heading the tip must take, whole turns included, or None [rad].
        lower: bounds of the variables, shape (variables,).
        upper: likewise.
        parameters: values of the parameters.
    """

    task: ConfigurationTask
    program: Program
    regions: tuple[int, ...]
    tip_heading: float | None
    lower: FloatArray
    upper: FloatArray
    parameters: FloatArray

    def with_constraint(self, name: str, expression: ca.SX, lower: float, upper: float) -> "ConfigurationNLP":
        """The NLP with one more scalar row over ``program.variables``; its solver is built anew."""
        program = replace(
            self.program,
            constraints=ca.vertcat(self.program.constraints, expression),
            row_names=(*self.program.row_names, name),
            lower=np.append(self.program.lower, lower),
            upper=np.append(self.program.upper, upper),
        )
        return replace(self, program=program)

    def with_cost(self, expression: ca.SX) -> "ConfigurationNLP":
        """The NLP with one more term in its objective; its solver is built anew."""
        return replace(self, program=replace(self.program, objective=self.program.objective + expression))


def build_configuration_nlp(
    task: ConfigurationTask, regions: tuple[int, ...] | None = None, tip_heading: float | None = None
) -> ConfigurationNLP:
    """Build the multiple-shooting NLP of a task; nothing is solved.

    Args:
        task: what the configuration must achieve.
        regions: index of a region for each segment, increasing, each region at least once; by default
            ``task.segments_per_region`` segments in each.
        tip_heading: the tip's heading with its whole turns [rad]; by default ``task.goal_heading``.
    """
    if regions is None:
        regions = tuple(np.repeat(np.arange(len(task.corridor.regions)), task.segments_per_region).tolist())
    if tip_heading is None:
        tip_heading = task.goal_heading
    half_planes = padded_rows(max(len(region.offsets) for region in task.corridor.regions))
    program = symbolic_program(len(regions), half_planes)
    lower, upper = _variable_bounds(task, len(regions), tip_heading)
    parameters = _parameter_values(task, regions, half_planes)
    if task.fixed_knots:
        program = _with_fixed_knots(program)
    nlp = ConfigurationNLP(task, program, regions, tip_heading, lower, upper, parameters)
    return nlp.with_cost(_nearness(nlp)) if task.clearance_weight > 0.0 and task.side_gaps else nlp


def _nearness(nlp: ConfigurationNLP) -> ca.SX:
    """What nearness of the curve's points to the walls behind their regions' sides costs."""
    task, total = nlp.task, ca.SX(0)
    variables = nlp.program.variables
    for k, index in enumerate(nlp.regions):
        stage = variables[STAGE * k : STAGE * (k + 1)]
        points = SegmentFlow(*segment_function()(stage[:STATES], stage[STATES:])).points
        region = task.corridor.regions[index]
        walls = (region.offsets + task.side_gaps[index] - region.normals @ task.base) / task.length
        total += nearness(points, region.normals, walls) / len(nlp.regions)
    return task.clearance_weight * total


def padded_rows(count: int) -> int:
    """The number of half-planes a solver is built for, the next of a few sizes so that solvers are shared."""
    return next((size for size in _ROW_SIZES if size >= count), count)


def pack(states: FloatArray, controls: FloatArray) -> FloatArray:
    """One column of variables from states (K + 1, 5) and controls (K, 12)."""
    return np.append(np.hstack((states[:-1], controls)).ravel(), states[-1])


def unpack(variables: FloatArray) -> tuple[FloatArray, FloatArray]:
    """States (K + 1, 5) and controls (K, 12) from one column of variables."""
    stages = variables[:-STATES].reshape(-1, STAGE)
    return np.vstack((stages[:, :STATES], variables[-STATES:])), stages[:, STATES:]


@cache
def symbolic_program(segments: int, half_planes: int) -> Program:
    """Symbols, objective and rows for a number of segments and half-planes a region."""
    states = [ca.SX.sym(f"X{k}", STATES) for k in range(segments + 1)]
    controls = [ca.SX.sym(f"U{k}", CONTROLS) for k in range(segments)]
    normals = [ca.SX.sym(f"A{k}", half_planes, 2) for k in range(segments)]
    offsets = [ca.SX.sym(f"b{k}", half_planes) for k in range(segments)]
    fraction, stub, weight = ca.SX.sym("fraction"), ca.SX.sym("stub"), ca.SX.sym("bending")
    objective, blocks = ca.SX(0), []
    for k in range(segments):
        flow = SegmentFlow(*segment_function()(states[k], controls[k]))
        objective += configuration_cost(states[k], controls[k], flow.bending, weight)
        blocks += [
            constraints.gap_closing(k, flow, states[k + 1]),
            constraints.knot_spacing(k, controls[k], fraction),
            constraints.certified_curvature(k, controls[k], flow),
            constraints.certified_containment(
                k, controls[k], flow, normals[k], offsets[k], (k == 0, k == segments - 1)
            ),
        ]
    blocks.insert(1, constraints.base_position(states[0], stub))  # after the first gap: FATROP's order of rows
    stages = [symbol for pair in zip(states[:-1], controls, strict=True) for symbol in pair]
    region_symbols = [symbol for pair in zip(normals, offsets, strict=True) for symbol in (ca.vec(pair[0]), pair[1])]
    return Program(
        segments,
        half_planes,
        ca.vertcat(*stages, states[-1]),
        ca.vertcat(*region_symbols, fraction, stub, weight),
        objective,
        ca.vertcat(*(block.expression for block in blocks)),
        tuple(name for block in blocks for name in block.names),
        np.concatenate([block.lower for block in blocks]),
        np.concatenate([block.upper for block in blocks]),
    )


@cache
def _with_fixed_knots(program: Program) -> Program:
    """Spacing rows as equations a_i = L_k / 4; the last of the four follows from the others."""
    upper = program.upper.copy()
    for row, name in enumerate(program.row_names):
        if "spacing of knots" in name and not name.endswith(f"{PIECES - 1} and {PIECES}"):
            upper[row] = 0.0
    return replace(program, upper=upper)


def _variable_bounds(
    task: ConfigurationTask, segments: int, tip_heading: float | None
) -> tuple[FloatArray, FloatArray]:
    limit = task.curvature_limit * task.length * (1.0 - CURVATURE_RESERVE)
    state = np.array([np.inf, np.inf, np.inf, limit, 1.0])
    control = np.repeat([limit, 1.0, limit], 4)
    upper = pack(np.tile(state, (segments + 1, 1)), np.tile(control, (segments, 1)))
    lower = -upper
    states, controls = unpack(lower)
    states[:, 4] = task.stub / task.length
    controls[:, 4:8], controls[:, 8:] = LEAST_PIECE, 0.0
    lower = pack(states, controls)
    lower[2], upper[2] = task.base_heading_range
    lower[4] = upper[4] = task.stub / task.length
    if task.stub > 0.0:
        lower[3] = upper[3] = 0.0
    lower[-5:-3] = upper[-5:-3] = (task.goal - task.base) / task.length
    lower[-1] = upper[-1] = 1.0
    if tip_heading is not None:
        lower[-3] = upper[-3] = tip_heading
    return lower, upper


def _parameter_values(task: ConfigurationTask, regions: tuple[int, ...], half_planes: int) -> FloatArray:
    blocks = [_half_planes(task, task.corridor.regions[index], half_planes) for index in regions]
    fraction = 1.0 / PIECES if task.fixed_knots else LEAST_SPACING
    return np.concatenate([*blocks, [fraction, task.stub / task.length, task.bending_weight]])


def _half_planes(task: ConfigurationTask, region: ConvexRegion, count: int) -> FloatArray:
    """Normals, column-major, then offsets of one region in the NLP's units; padded rows hold always."""
    offsets = (region.offsets - region.normals @ task.base) / task.length
    ends = np.array([[0.0, 0.0], task.goal - task.base]) / task.length
    slack = offsets - ends @ region.normals.T
    room = np.where(slack > -END_TOLERANCE / task.length, slack, np.inf).min(axis=0)
    offsets = offsets - np.minimum(SHRINK, np.where(room > 0.0, 0.5 * room, room))
    padding = count - len(offsets)
    normals = np.vstack((region.normals, np.zeros((padding, 2))))
    return np.concatenate((normals.ravel(order="F"), offsets, np.ones(padding)))
