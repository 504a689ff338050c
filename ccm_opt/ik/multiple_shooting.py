"""Nonlinear program for a planar curve through a corridor, by multiple shooting, solved by IPOPT."""

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import casadi as ca
import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.ipopt_call import ipopt_answer
from ccm_opt.ik import curve_program as constraints
from ccm_opt.ik.configuration_task import END_TOLERANCE, ConfigurationTask
from ccm_opt.ik.curve_program import CONTROLS, STATES, SegmentFlow, configuration_cost, nearness, segment_function
from ccm_opt.ik.row_program import (
    IPOPT_SWITCHES,
    RowAnswer,
    RowBlock,
    RowProgram,
    Symbols,
    built_solver,
    row_answer,
)
from ccm_opt.scene.corridor import ConvexRegion

_LEAST_PIECE = 4e-3
"""Least arc length between knots [arm lengths]. Heuristic."""
_LEAST_SPACING = 0.08
"""Least length of a spline piece, as a fraction of the length of its segment. Heuristic."""

_REGION_SHRINKAGE = 1e-5
"""Distance by which regions are shrunk, so that quadrature errors and the final Newton correction stay inside the real
regions [arm lengths]. Derived: ten times the tolerance of the check of containment on an arm of a metre."""
_CURVATURE_RESERVE = 1e-3
"""Fraction of the curvature limit that is reserved for the final Newton correction. Heuristic."""
_HALF_PLANE_COUNTS = (4, 6, 8, 12, 16, 24, 32, 48, 64)
"""Numbers of half-planes per region for which solvers are built, so that tasks share solvers. Heuristic."""

STAGE = STATES + CONTROLS
"""Number of NLP variables of one segment: the state at its start and its control."""


@dataclass(frozen=True, eq=False)
class ConfigurationNLP:
    """NLP for a curve that solves one task: a symbolic program with numerical bounds and parameters.

    Lengths are in units of the arm's length; the base is the origin.

    Attributes:
        task: the task to be solved.
        program: symbolic variables, rows and objective.
        regions: index of the corridor's region in which each curvature segment must stay.
        tip_heading: prescribed heading of the tip, whole turns included [rad], or None.
        lower: lower bounds of the variables, shape (variables,).
        upper: upper bounds of the variables, shape (variables,).
        parameters: values of the program's parameters, shape (parameters,).
    """

    task: ConfigurationTask
    program: RowProgram
    regions: tuple[int, ...]
    tip_heading: float | None
    lower: FloatArray
    upper: FloatArray
    parameters: FloatArray

    def with_cost(self, expression: ca.SX) -> "ConfigurationNLP":
        """Return the NLP with a further term in its objective, for which a new solver will be built."""
        return replace(self, program=replace(self.program, objective=self.program.objective + expression))


def build_configuration_nlp(
    task: ConfigurationTask, regions: tuple[int, ...] | None = None, tip_heading: float | None = None
) -> ConfigurationNLP:
    """Return the multiple-shooting NLP for a curve that solves a task; nothing is solved.

    Args:
        task: the task.
        regions: index of the region in which each curvature segment must stay, not decreasing, each region at least
            once; by default one segment per region.
        tip_heading: heading of the tip including whole turns [rad]; by default ``task.goal_heading``.
    """
    if regions is None:
        regions = tuple(range(len(task.corridor.regions)))
    if tip_heading is None:
        tip_heading = task.goal_heading
    most = max(len(region.offsets) for region in task.corridor.regions)
    half_planes = next((count for count in _HALF_PLANE_COUNTS if count >= most), most)
    program = symbolic_program(len(regions), half_planes)
    lower, upper = _variable_bounds(task, len(regions), tip_heading)
    blocks = [_half_planes(task, task.corridor.regions[index], half_planes) for index in regions]
    parameters = np.concatenate([*blocks, [task.stub / task.length, task.bending_weight]])
    nlp = ConfigurationNLP(task, program, regions, tip_heading, lower, upper, parameters)
    return nlp.with_cost(_nearness(nlp)) if task.clearance_weight > 0.0 and task.side_gaps else nlp


def _nearness(nlp: ConfigurationNLP) -> ca.SX:
    """Return the NLP's cost of curve points close to the walls behind the sides of their regions."""
    task = nlp.task
    total = ca.SX(0)
    variables = nlp.program.variables
    for k, index in enumerate(nlp.regions):
        stage = variables[STAGE * k : STAGE * (k + 1)]
        points = SegmentFlow(*segment_function()(stage[:STATES], stage[STATES:])).points
        region = task.corridor.regions[index]
        walls = (region.offsets + task.side_gaps[index] - region.normals @ task.base) / task.length
        total += nearness(points, region.normals, walls) / len(nlp.regions)
    return task.clearance_weight * total


def pack_variables(states: FloatArray, controls: FloatArray) -> FloatArray:
    """Return the column of NLP variables for the states (K + 1, 5) and controls (K, 12) of K curvature segments."""
    return np.append(np.hstack((states[:-1], controls)).ravel(), states[-1])


def unpack_variables(variables: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the states (K + 1, 5) and controls (K, 12) of K curvature segments from a column of NLP variables."""
    stages = variables[:-STATES].reshape(-1, STAGE)
    return np.vstack((stages[:, :STATES], variables[-STATES:])), stages[:, STATES:]


# Tasks share few programs, and each keeps a built solver of tens of megabytes alive.
@lru_cache(maxsize=4)
def symbolic_program(segments: int, half_planes: int) -> RowProgram:
    """Return the symbolic NLP for a number K of curvature segments and a number of half-planes per region.

    The variables are the states and controls X_0, U_0, X_1, U_1, .., X_K; the parameters are the normals and offsets of
    the region of each segment, the length of the straight stub at the base and the weight of the bending.
    """
    states = [ca.SX.sym(f"X{k}", STATES) for k in range(segments + 1)]
    controls = [ca.SX.sym(f"U{k}", CONTROLS) for k in range(segments)]
    normals = [ca.SX.sym(f"A{k}", half_planes, 2) for k in range(segments)]
    offsets = [ca.SX.sym(f"b{k}", half_planes) for k in range(segments)]
    stub = ca.SX.sym("stub")
    weight = ca.SX.sym("bending")

    objective = ca.SX(0)
    blocks: list[RowBlock] = []
    for k in range(segments):
        flow = SegmentFlow(*segment_function()(states[k], controls[k]))
        objective += configuration_cost(states[k], controls[k], flow.bending, weight)
        ends = (k == 0, k == segments - 1)
        blocks += [
            constraints.gap_closing(k, flow, states[k + 1]),
            constraints.knot_spacing(k, controls[k], _LEAST_SPACING),
            constraints.certified_curvature(k, controls[k], flow),
            constraints.certified_containment(k, controls[k], flow, normals[k], offsets[k], ends),
        ]
    blocks.insert(
        1, constraints.base_at_stub_end(states[0], stub)
    )  # after the first gap, the order of rows that FATROP wants

    stages = [symbol for pair in zip(states[:-1], controls, strict=True) for symbol in pair]
    region_symbols = [symbol for pair in zip(normals, offsets, strict=True) for symbol in (ca.vec(pair[0]), pair[1])]
    return RowProgram(
        unknowns=Symbols({"stages": ca.vertcat(*stages, states[-1])}),
        parameters=Symbols({"regions": ca.vertcat(*region_symbols), "stub": stub, "bending": weight}),
        rows=tuple(blocks),
        parts={},
        objective=objective,
    )


def _variable_bounds(
    task: ConfigurationTask, segments: int, tip_heading: float | None
) -> tuple[FloatArray, FloatArray]:
    """Return the lower and upper bounds of the NLP's variables, each of shape (variables,).

    Known quantities are variables with equal bounds: base, goal, arc length at both ends, prescribed headings.

    Args:
        task: the task.
        segments: number of curvature segments.
        tip_heading: heading of the tip including whole turns [rad], or None if free.
    """
    limit = task.curvature_limit * task.length * (1.0 - _CURVATURE_RESERVE)
    state = np.array([np.inf, np.inf, np.inf, limit, 1.0])
    control = np.repeat([limit, 1.0, limit], 4)
    upper = pack_variables(np.tile(state, (segments + 1, 1)), np.tile(control, (segments, 1)))
    lower = -upper
    states, controls = unpack_variables(lower)
    states[:, 4] = task.stub / task.length
    controls[:, 4:8] = _LEAST_PIECE
    controls[:, 8:] = 0.0  # the bounds on |κ|
    lower = pack_variables(states, controls)

    lower[2], upper[2] = task.base_heading_range
    lower[4] = upper[4] = task.stub / task.length
    if task.stub > 0.0:
        lower[3] = upper[3] = 0.0  # the curvature is continuous with the straight stub
    lower[-5:-3] = upper[-5:-3] = (task.goal - task.base) / task.length
    lower[-1] = upper[-1] = 1.0
    if tip_heading is not None:
        lower[-3] = upper[-3] = tip_heading
    return lower, upper


def _half_planes(task: ConfigurationTask, region: ConvexRegion, count: int) -> FloatArray:
    """Return the normals (column-major) and then the offsets of a region's half-planes, for the NLP.

    Lengths are in units of the arm, measured from the base.

    Args:
        task: the task, for its base, goal and length.
        region: the region, which is shrunk slightly.
        count: number of half-planes; the region's own are padded with rows that always hold.
    """
    offsets = (region.offsets - region.normals @ task.base) / task.length

    # A base or goal that lies in the region stays in it: a side close to one moves by half the distance.
    ends = np.array([[0.0, 0.0], task.goal - task.base]) / task.length
    slack = offsets - ends @ region.normals.T
    room = np.where(slack > -END_TOLERANCE / task.length, slack, np.inf).min(axis=0)
    offsets = offsets - np.minimum(_REGION_SHRINKAGE, np.where(room > 0.0, 0.5 * room, room))

    padding = count - len(offsets)
    normals = np.vstack((region.normals, np.zeros((padding, 2))))
    return np.concatenate((normals.ravel(order="F"), offsets, np.ones(padding)))


_MOST_ITERATIONS = 80
"""Maximum number of iterations of IPOPT. Heuristic."""
_OPTIMALITY = 1e-4
"""Residual of the optimality conditions, in the NLP's units, at which IPOPT stops. Heuristic: coarse, since a Newton
correction follows."""
_FEASIBILITY = 1e-6
"""Violation up to which a constraint counts as satisfied, in the NLP's units. Heuristic; the Newton correction reduces
it further."""
_OPTIONS = {
    **IPOPT_SWITCHES,
    "ipopt.tol": _OPTIMALITY,
    "ipopt.constr_viol_tol": 0.1 * _FEASIBILITY,
    "ipopt.mu_init": 0.1,
    "ipopt.max_iter": _MOST_ITERATIONS,
}


def solve_nlp(nlp: ConfigurationNLP, guess: FloatArray) -> RowAnswer:
    """Solve a configuration NLP from an initial guess and return IPOPT's answer, whether or not it converged.

    One thread at a time can solve.

    Args:
        nlp: the NLP from ``build_configuration_nlp``, possibly with further costs.
        guess: initial values of the variables, shape (variables,).

    Raises:
        KeyboardInterrupt: Ctrl-C was pressed during the solution.
    """
    lower, upper = nlp.program.bounds
    bounds = {"lbx": nlp.lower, "ubx": nlp.upper, "lbg": lower, "ubg": upper}
    solver = partial(built_solver, nlp.program, _OPTIONS, by_blocks=False)
    answer, statistics = ipopt_answer(solver, guess, p=nlp.parameters, **bounds)
    return row_answer(nlp.program, answer, statistics, feasible=_FEASIBILITY)
