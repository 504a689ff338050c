"""The optimisation of a motion: rows against geometry, slopes against differences, certified and shorter results."""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.planning.limits.clearance_rows import sweep_regions
from ccm_opt.planning.limits.limit import KeyframeRows, Quadratic
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.interval_rows import STILL, IntervalRows, Sweep, joined_rows, representatives
from ccm_opt.planning.optimisation.objective import Objective, decimated, subdivided
from ccm_opt.planning.optimisation.optimise import optimise, thinned
from ccm_opt.planning.optimisation.program import KeyframeProgram, LinearMotion
from ccm_opt.planning.optimisation.staged_program import NO_PART, StageRows, solve_stages
from ccm_opt.planning.strategies import find_motion
from ccm_opt.planning.swept_motion import PlanarSweep
from ccm_opt.problem import JointPose, OptimiserName
from ccm_opt.problem.solution import ClearanceLimit
from tests.oracles.interior_point import interior_point
from tests.scenes import Scene, clutter, later, make_arm, mixed_walls, motion_task, rows_of, sweep_gaps, swept

SEEDS = (0, 5, 14)
SEQUENTIAL: OptimiserName = "sequential-convex"


def random_sweep(seed: int, intervals: int = 3, size: float = 0.3) -> PlanarSweep:
    """A wandering motion of the arm among nothing."""
    rng = np.random.default_rng(seed)
    space, start = LinkSpace.through(make_arm(), rng.normal(0.0, 0.5, 24) / 4.0)
    steps = size * rng.normal(size=(intervals, len(start)))
    return PlanarSweep(space, np.vstack((start, start + np.cumsum(steps, axis=0))))


def some_rows(sweep: PlanarSweep) -> IntervalRows:
    """Rows of a sweep among walls of every kind."""
    workspace = mixed_walls()
    return rows_of(sweep, workspace, 1e-3, 0.3)


@cache
def found(seed: int, *, whole_arm: bool = False) -> tuple[Scene, MotionTask, Motion]:
    """A scene, its task and the motion that the search finds when it does not optimise."""
    scene = clutter(seed, 10)
    problem = scene.problem(JointPose(scene.arm.bends(scene.goal)) if whole_arm else None)
    task = replace(motion_task(problem, guessing=True), optimiser="none")
    return scene, task, find_motion(task)


@pytest.mark.parametrize("seed", SEEDS)
def test_optimised_motion_is_shorter_and_keeps_clear(seed: int) -> None:
    """A motion comes out shorter, with the same start, and a dense sweep of it touches nothing."""
    scene, task, motion = found(seed)
    optimised = optimise(motion, replace(task, optimiser=SEQUENTIAL))
    assert optimised.travel < 0.8 * motion.travel
    assert np.array_equal(optimised.unknowns[0], motion.unknowns[0])
    assert np.allclose(scene.arm.headings(optimised.configurations[0]), scene.start, atol=1e-12)
    poses = scene.arm.headings(optimised.configurations)
    frames = [swept(a, b, 30) for a, b in pairwise(poses)]
    walls, own = sweep_gaps(scene.arm, scene.workspace, np.vstack(frames))
    assert walls > 0.0
    assert own > 0.0


@pytest.mark.parametrize("seed", SEEDS)
def test_optimised_motion_ends_on_the_goal_within_joint_limits(seed: int) -> None:
    """The last keyframe meets position and heading of the goal, and no bend passes its limit."""
    scene, task, motion = found(seed)
    headings = scene.arm.headings(optimise(motion, replace(task, optimiser=SEQUENTIAL)).configurations)
    tip = scene.arm.joint_positions(headings[-1])[-1]
    assert np.allclose(tip, scene.goal_tip.position, atol=1e-7)
    assert np.cos(headings[-1, -1] - scene.goal_tip.heading) > 1.0 - 1e-12
    assert np.all(np.abs(scene.arm.bends(headings)) <= scene.arm.bend_limits)


def test_whole_arm_goal_stays_fixed() -> None:
    """With a goal for the whole arm the last keyframe does not move."""
    scene, task, motion = found(5, whole_arm=True)
    optimised = optimise(motion, replace(task, optimiser=SEQUENTIAL))
    assert optimised.travel < motion.travel
    assert np.allclose(scene.arm.headings(optimised.configurations[-1]), scene.goal, atol=1e-9)


@pytest.mark.drawn(6, of="whole plans")
def test_interior_point_agrees_with_sequential_convex() -> None:
    """IPOPT on the same rows shortens a motion about as much, and its result is certified too."""
    _, task, motion = found(0)
    ours = optimise(motion, replace(task, optimiser=SEQUENTIAL))
    keyframes, u = thinned(motion, task)
    coordinates = interior_point(replace(task.program(motion), u=u), keyframes)
    reference = motion.through(coordinates)
    assert len(task.certificate.failures(reference.configurations)) == 0
    assert ours.travel == pytest.approx(reference.travel, rel=0.15)


def test_nothing_is_lost_when_time_is_up() -> None:
    """After the deadline the given motion comes back as it is."""
    _, task, motion = found(0)
    assert optimise(motion, replace(task, optimiser=SEQUENTIAL, deadline=later(-1.0))) is motion


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_half_planes_leave_walls_outside(seed: int) -> None:
    """Behind every half-plane lies a wall, and every wall near a link's sweep is behind one of its half-planes."""
    sweep = random_sweep(seed, 1)
    workspace = mixed_walls()
    planes = sweep_regions(sweep, workspace.wall_segments, 0, 0.2)
    segments = workspace.wall_segments
    for link in np.unique(planes.link):
        own = planes.take(planes.link == link)
        depth = np.einsum("eid,pd->pei", segments.ends, own.normal).min(axis=2) - segments.rounding - own.bound[:, None]
        assert np.all(np.any(depth >= -1e-9, axis=1))
        corners = np.vstack((sweep.points[:2, link], sweep.points[:2, link + 1], sweep.middles[0, link : link + 2]))
        hull = shapely.MultiPoint(corners).convex_hull
        gaps = np.array([hull.distance(wall) for wall in segments.tree.geometries]) - segments.rounding
        near = gaps < 0.2
        assert np.all(np.any(depth[:, near] >= -1e-9, axis=0))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_slopes_of_rows_match_differences(seed: int) -> None:
    """Derivatives of the rows by the coordinates agree with central differences."""
    sweep = random_sweep(seed)
    rows = some_rows(sweep)
    direction = np.random.default_rng(seed).normal(size=sweep.unknowns.shape)
    h = 1e-6
    ahead, behind = (rows.values(PlanarSweep(sweep.space, sweep.unknowns + s * h * direction)) for s in (1.0, -1.0))
    start, end = rows.slopes(sweep)
    along = np.einsum("mp,mp->m", start, direction[rows.interval])
    along += np.einsum("mp,mp->m", end, direction[rows.interval + 1])
    assert np.allclose(along, (ahead - behind) / (2.0 * h), atol=1e-6)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_curvature_of_rows_matches_second_differences(seed: int) -> None:
    """The diagonal curvature of the weighted rows, the tip's pull included, is their second derivative."""
    sweep = random_sweep(seed)
    rng = np.random.default_rng(seed)
    rows = some_rows(sweep)
    weights = rng.uniform(size=len(rows))
    pull = rng.normal(size=2)
    direction = rng.normal(size=sweep.unknowns.shape)

    def lagrangian(step: float) -> float:
        moved = PlanarSweep(sweep.space, sweep.unknowns + step * direction)
        return float(weights @ rows.values(moved) + pull @ moved.points[-1, sweep.space.arm.links])

    h = 1e-4
    wanted = (lagrangian(h) - 2.0 * lagrangian(0.0) + lagrangian(-h)) / h**2
    bend, sag = sweep.heading_curvature(rows, weights, pull)
    turn = direction @ sweep.space.turns.T
    got = np.sum(bend * turn**2) + np.sum(sag * np.diff(turn, axis=0) ** 2)
    assert got == pytest.approx(wanted, rel=1e-3, abs=1e-3 * float(np.abs(weights).sum()))


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_objective_is_a_quadratic_form_of_its_blocks(seed: int) -> None:
    """Value, gradient and Hessian blocks describe one quadratic."""
    sweep = random_sweep(seed, 4)
    objective = Objective(sweep.space, 4)
    v = sweep.unknowns
    k, m = np.indices((5, 5)).reshape(2, -1)
    blocks = objective.blocks(sweep, k, m).reshape(5, 5, *objective.shape.shape)
    gradient = np.einsum("kmpq,mq->kp", blocks, v)
    assert np.allclose(objective.gradient(sweep), gradient)
    assert objective.value(sweep) == pytest.approx(0.5 * float(np.vdot(v, gradient)))


def stage_rows(rng: np.random.Generator, count: int, stages: int, width: int, parts: int) -> StageRows:
    """Random rows, some of them with slack."""
    stage, part = rng.integers(0, stages, count), rng.integers(NO_PART, parts, count)
    own, before = rng.normal(size=(2, count, width))
    return StageRows(stage, before, own, rng.normal(size=count), part)


@settings(max_examples=50, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    stages=st.integers(1, 7),
    count=st.integers(0, 60),
    price=st.floats(0.1, 1e4),
    guessed=st.floats(0.0, 1.0),
)
def test_programs_of_stages_are_solved(seed: int, stages: int, count: int, price: float, guessed: float) -> None:
    """The solution satisfies the conditions of Karush, Kuhn and Tucker, which are sufficient, whatever is guessed."""
    rng = np.random.default_rng(seed)
    width, parts = 4, 3
    n = stages * width
    root = np.triu(np.tril(rng.normal(size=(n, n))), 1 - 2 * width)
    hessian = np.kron(np.abs(np.subtract.outer(range(stages), range(stages))) <= 2, np.ones((width, width))) * (
        root @ root.T
    ) + 10.0 * n * np.eye(n)
    blocks = np.zeros((3, stages, width, width))
    for apart, k in ((a, k) for a in range(3) for k in range(a, stages)):
        blocks[apart, k] = hessian[k * width : (k + 1) * width, (k - apart) * width : (k - apart + 1) * width]
    gradient, prices = 100.0 * rng.normal(size=(stages, width)), np.full(parts, price)
    equal = replace(stage_rows(rng, 2, stages, width, parts), bound=np.zeros(2), part=np.full(2, NO_PART))
    rows = stage_rows(rng, count, stages, width, parts)
    rows = replace(rows, bound=np.where(rows.part == NO_PART, np.abs(rows.bound), rows.bound))
    likely = rng.choice(3, count, p=[1.0 - guessed, 0.5 * guessed, 0.5 * guessed])
    found = solve_stages(blocks, gradient, equal, rows, prices, likely)
    assert found is not None
    matrix, ties = (np.array([r.at(i, stages).ravel() for i in range(len(r))]).reshape(-1, n) for r in (rows, equal))
    slack = np.where(rows.part == NO_PART, 0.0, found.slack[rows.part])
    left = rows.bound + slack - rows.times(found.x)
    scale = 1e-9 * (1.0 + np.abs(found.multipliers).max(initial=0.0)) * (1.0 + np.abs(gradient).max())
    assert (
        np.abs(hessian @ found.x.ravel() + gradient.ravel() + ties.T @ found.pulls + matrix.T @ found.multipliers).max()
        < scale
    )
    assert np.abs(equal.times(found.x)).max() < 1e-8
    assert left.min(initial=0.0) >= -2e-5
    assert np.all(found.multipliers * np.abs(left) <= 2e-5 * (1.0 + found.multipliers))
    loads = np.bincount(rows.part[rows.part >= 0], found.multipliers[rows.part >= 0], parts)
    assert np.all(loads <= prices * (1.0 + 1e-4 * found.slack) * (1.0 + 1e-6))
    assert np.all(loads[found.slack > 1e-6] >= prices[found.slack > 1e-6] * (1.0 - 1e-6))


def test_programs_without_a_solution_are_told() -> None:
    """Rows that exclude each other give no solution."""
    away = StageRows(
        np.zeros(2, dtype=np.intp), np.zeros((2, 1)), np.array([[1.0], [-1.0]]), np.full(2, -1.0), np.full(2, NO_PART)
    )
    none = replace(away, **{name: getattr(away, name)[:0] for name in ("stage", "before", "own", "bound", "part")})
    assert solve_stages(np.ones((3, 1, 1, 1)), np.zeros((1, 1)), none, away, np.zeros(0)) is None


def test_step_in_free_space_straightens_the_motion() -> None:
    """Without rows and damping one step to fixed ends reaches the minimum of the objective."""
    sweep = random_sweep(3, 6, size=0.01)
    objective = Objective(sweep.space, 6)
    rows = some_rows(sweep).take(np.zeros(0, dtype=np.intp))
    ends = np.eye(sweep.unknowns.shape[1])
    motion = LinearMotion(
        sweep, objective, (), rows, rows, (), (), ends, end_fixed=True, unit=sweep.space.nominal_length
    )
    step = KeyframeProgram(motion, np.full(6, 30.0), None, 0.0).solve()
    assert step is not None
    gradient = objective.gradient(replace(sweep, unknowns=sweep.unknowns + step.change))[1:-1]
    assert np.allclose(step.change[[0, -1]], 0.0, atol=1e-6)
    assert np.abs(gradient).max() < 1e-3 * np.abs(objective.gradient(sweep)).max()


class Stiff:
    """A steep cost of any change of a motion."""

    def value(self, sweep: Sweep) -> float:
        """Return no cost for the motion as it is."""
        del sweep
        return 0.0

    def predicted(self, sweep: Sweep, change: FloatArray) -> float:
        """Return the cost of a change."""
        del sweep
        return 0.5e9 * float(np.vdot(change, change))

    def model(self, sweep: Sweep) -> Quadratic:
        """Return the model of that cost."""
        k, p = sweep.unknowns.shape
        return Quadratic(np.zeros((k, p)), np.tile(1e9 * np.eye(p), (k, 1, 1)), np.zeros((k - 1, p, p)))


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_model_of_a_cost_predicts_its_gradient(seed: int) -> None:
    """After a change of the coordinates, the gradient is that of the quadratic form with the model's Hessian."""
    rng = np.random.default_rng(seed)
    half, above = rng.normal(size=(5, 3, 3)), rng.normal(size=(4, 3, 3))
    model = Quadratic(rng.normal(size=(5, 3)), half + half.transpose(0, 2, 1), above)
    change = rng.normal(size=(5, 3))
    hessian = np.zeros((5, 3, 5, 3))
    for k in range(5):
        hessian[k, :, k] = model.diagonal[k]
    for k in range(4):
        hessian[k, :, k + 1] = above[k]
        hessian[k + 1, :, k] = above[k].T
    wanted = model.gradient + np.einsum("kpmq,mq->kp", hessian, change)
    np.testing.assert_allclose(model.gradient_after(change), wanted, atol=1e-12)


@pytest.mark.parametrize(
    ("limit", "interval", "price", "opposite"),
    [
        ("walls", 2, 1e4, STILL),
        ("links", 2, 1e4, 0),
        ("joint limits", 2, 1e4, None),
        ("goal", 5, 1e4, None),
        ("constraints", 2, 1e4, None),
        ("costs", 2, 1e4, None),
        ("length", 2, 1e-3, None),
        ("steps", 2, 1e4, None),
        (None, 2, 1e4, None),
    ],
)
def test_what_limits_clearance_is_what_pushes_against_it(
    limit: ClearanceLimit | None, interval: int, price: float, opposite: int | None
) -> None:
    """A tip that lacks clearance on one side is held by what is on the other side, or by its cost; else by nothing."""
    sweep = random_sweep(4, 6, size=0.0)
    unit, p = sweep.space.nominal_length, sweep.unknowns.shape[1]
    tip = sweep.points[0, -3]
    sides = [(STILL, 1.0, (-0.5 if limit is None else 0.5) * unit)] + (
        [] if opposite is None else [(opposite, -1.0, 0.3 * unit)]
    )
    normal = np.array([[0.0, side] for _, side, _ in sides])
    minus = np.array([other for other, _, _ in sides])
    lacks = np.array([lack for _, _, lack in sides])
    where = np.full(len(sides), interval)
    same = np.full(len(sides), sweep.space.arm.links)
    away = tip - np.where((minus == STILL)[:, None], 0.0, sweep.points[0, minus])
    rows = IntervalRows(
        where, np.ones(len(sides)), same, minus, same, same, normal, lacks - np.einsum("md,md->m", normal, away)
    )
    keyframe = np.repeat(np.arange(1, 7), p)
    fixed = KeyframeRows(keyframe, np.tile(np.eye(p), (6, 1)), np.full(6 * p, -1e-6), np.full(6 * p, 1e-6))
    motion = LinearMotion(
        sweep,
        Objective(sweep.space, 6),
        (Stiff(),) if limit == "costs" else (),
        rows,
        rows,
        (fixed,) if limit == "joint limits" else (),
        (replace(fixed, kind="constraints"),) if limit == "constraints" else (),
        np.eye(p),
        end_fixed=True,
        unit=unit,
    )
    assert KeyframeProgram(motion, np.full(6, price), None, 0.1).clearance_limit(0.3) == limit


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 30))
def test_subdividing_keeps_the_path(seed: int, count: int) -> None:
    """Keyframes are only added, on the legs, until there are as many intervals as asked for."""
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(5, 3))
    fine = subdivided(corners, np.linalg.norm(np.diff(corners, axis=0), axis=1), count)
    assert len(fine) == max(count, 4) + 1
    assert all(np.any(np.all(np.isclose(fine, corner), axis=1)) for corner in corners)
    line = shapely.LineString(corners[:, :2])
    assert all(line.distance(shapely.Point(point[:2])) < 1e-12 for point in fine)


def test_decimating_keeps_legs_that_pass() -> None:
    """Legs are halved until the judge lets them pass or no keyframe is left between."""
    coordinates = np.arange(50.0)[:, None]
    kept = decimated(coordinates, lambda v: np.flatnonzero(np.diff(v[:, 0]) > 5.0), 16)[:, 0]
    assert kept[0] == 0.0
    assert kept[-1] == 49.0
    assert np.diff(kept).max() <= 5.0


def test_thinned_motion_is_certified() -> None:
    """Few keyframes of a found motion still pass the certificate."""
    _, task, motion = found(0)
    few, _ = thinned(motion, task)
    assert len(few) < len(motion.unknowns)
    assert len(task.certificate.failures(motion.curve.configurations(few))) == 0


def test_representatives_are_the_tightest() -> None:
    """Of rows that differ in value alone the tightest is kept."""
    rows = some_rows(random_sweep(1))
    looser = replace(rows, constant=rows.constant - 1.0)
    both = joined_rows([looser, rows])
    sweep = random_sweep(1)
    kept = representatives(both, both.values(sweep), 1)
    assert np.all(kept >= len(rows))
    assert len(np.unique(kept)) == len(kept)
