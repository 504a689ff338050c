"""A step of the continuation: towards what it is drawn to, never nearer to contact than promised."""

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ccm_opt.planning.limits.limit_stack import allowed_shortfall, contact_rows, keeps_clear
from ccm_opt.planning.pose import Pose, Term, normal_equations
from ccm_opt.planning.settings import StepSettings
from ccm_opt.planning.step import Stepper
from ccm_opt.scene.contact_finder import WALL, WallFinder
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .scenes import MARGIN, Scene, clutter, corridor, make_arm, make_stepper, open_scene, self_gap, wall_gaps

SETTINGS = StepSettings()
TOLERANCE = 1e-6
"""Of the rows of the step, by the solver [rad]."""
seeds = st.integers(0, 2**32 - 1)


def random_pull(rng: np.random.Generator, stepper: Stepper, pose: Pose) -> list[Term]:
    """Draws the tip and every link somewhere, as a guide might."""
    links = stepper.space.arm.links
    return [
        Term(pose.moving[-1], rng.normal(0.0, 0.1, 2), 10.0),
        Term(stepper.space.turns, rng.normal(0.0, 0.1) + np.cumsum(rng.normal(0.0, 0.02, links)), 1.0),
    ]


def pushed_about(scene: Scene, seed: int, steps: int) -> list[Pose]:
    """Poses of many steps, each pull kept up for a while."""
    stepper, pose = make_stepper(scene)
    rng = np.random.default_rng(seed)
    poses = [pose]
    for _ in range(steps // 10):
        pull_seed = int(rng.integers(2**32))
        for _ in range(10):
            pose = stepper.step(pose, random_pull(np.random.default_rng(pull_seed), stepper, pose))
            poses.append(pose)
    return poses


@pytest.mark.parametrize("scene", [clutter(1, 30), clutter(2, 40), corridor(3, 0.06)], ids=["30", "40", "corridor"])
def test_clearance_keeps_its_promised_share(scene: Scene) -> None:
    """Pushed about among obstacles by random pulls, the arm keeps its share of the margin from all walls and itself."""
    poses = pushed_about(scene, 5, 200)
    points = np.array([pose.points for pose in poses])
    assert np.abs(np.diff([pose.q for pose in poses], axis=0)).max() > 0.05
    assert wall_gaps(scene.arm, scene.workspace, points).min() >= SETTINGS.keep_share * MARGIN - 1e-9
    assert self_gap(scene.arm, points) > 0.0
    for pose in poses[::10]:
        fresh = WallFinder(scene.arm, scene.workspace.flat_walls, 0.0, MARGIN, 0.04)
        assert keeps_clear(fresh.find(pose.points), 1e-9, SETTINGS.keep_share)
        assert not fresh.crosses(pose.points)


@settings(max_examples=25)
@given(seed=seeds, short=st.floats(0.05, 0.95))
def test_a_gap_below_the_share_never_shrinks(seed: int, short: float) -> None:
    """From a pose nearer to a post than its share of the margin no accepted step goes nearer than that to anything."""
    scene = open_scene(seed % 20)
    rng = np.random.default_rng(seed)
    points = scene.arm.joint_positions(scene.start)
    side = np.array([-np.sin(scene.start[-1]), np.cos(scene.start[-1])])
    gap = short * SETTINGS.keep_share * MARGIN
    post = Obstacle("post", PlaneShape(shapely.Point(points[-1] + (scene.arm.radius + 0.02 + gap) * side), 0.02))
    tight = Scene(scene.arm, Workspace(scene.workspace.boundary, (post,)), scene.start, scene.goal)
    stepper, pose = make_stepper(tight)
    before = wall_gaps(tight.arm, tight.workspace, pose.points).min()
    for _ in range(5):
        pose = stepper.step(pose, random_pull(rng, stepper, pose))
        after = wall_gaps(tight.arm, tight.workspace, pose.points).min()
        assert after >= min(before, SETTINGS.keep_share * MARGIN) - 1e-9
        before = after


def test_a_violated_margin_is_mended() -> None:
    """Left alone beside a post inside its margin, the arm moves away from it."""
    scene = open_scene(1)
    points = scene.arm.joint_positions(scene.start)
    side = np.array([-np.sin(scene.start[-1]), np.cos(scene.start[-1])])
    post = Obstacle(
        "post", PlaneShape(shapely.Point(points[-1] + (scene.arm.radius + 0.02 + 0.5 * MARGIN) * side), 0.02)
    )
    stepper, pose = make_stepper(
        Scene(scene.arm, Workspace(scene.workspace.boundary, (post,)), scene.start, scene.goal)
    )
    still = [Term(stepper.space.turns, np.zeros(24), 1e-3)]
    for _ in range(5):
        pose = stepper.step(pose, still)
    assert wall_gaps(scene.arm, Workspace(scene.workspace.boundary, (post,)), pose.points).min() > 0.95 * MARGIN


@pytest.mark.parametrize("limit", [20.0, 60.0])
def test_joint_limits_are_kept(limit: float) -> None:
    """However hard the links are pulled into a coil, every bend stays within its share of the limit, the base's too."""
    scene = open_scene(2)
    arm = make_arm(24, 0.0, joint_limit=np.deg2rad(limit), base_limit=0.5, self_collision=False)
    stepper, pose = make_stepper(Scene(arm, scene.workspace, np.zeros(24), np.zeros(24)))
    for _ in range(60):
        coil = [Term(stepper.space.turns, np.linspace(3.0, 20.0, 24), 1.0)]
        pose = stepper.step(pose, coil)
        assert (np.abs(pose.q) <= SETTINGS.limit_share * arm.bend_limits + TOLERANCE).all()
    assert np.abs(pose.q).max() > 0.9 * np.deg2rad(min(limit, 25.0))


def test_a_bend_beyond_its_share_is_not_made_worse() -> None:
    """A start at its very limit, which the format allows, can move; the bend there does not grow."""
    arm = make_arm(24, 0.0, joint_limit=0.3)
    start = np.cumsum(np.where(np.arange(24) == 12, 0.3, 0.05))
    stepper, pose = make_stepper(Scene(arm, open_scene(0).workspace, start, start))
    for _ in range(10):
        after = stepper.step(pose, [Term(stepper.space.turns, np.linspace(0.5, 3.0, 24), 1.0)])
        assert after is not pose
        assert abs(arm.bends(after.q)[12]) <= abs(pose.q[12]) + TOLERANCE
        pose = after


@settings(max_examples=30)
@given(seed=seeds, turn=st.sampled_from((0.03, SETTINGS.largest_turn)))
def test_no_link_turns_farther_than_allowed(seed: int, turn: float) -> None:
    """The largest turn of a step holds for every link, whatever pulls."""
    stepper, pose = make_stepper(open_scene(seed % 20))
    rng = np.random.default_rng(seed)
    after = stepper.step(pose, [Term(stepper.space.turns, rng.normal(0.0, 2.0, 24), 1.0)], turn)
    assert np.abs(np.cumsum(after.q - pose.q)).max() <= turn + TOLERANCE


@settings(max_examples=40)
@given(seed=seeds)
def test_in_the_open_the_tip_moves_towards_its_target(seed: int) -> None:
    """Without obstacles one step brings the tip nearer to a place some centimetres off."""
    stepper, pose = make_stepper(open_scene(seed % 20))
    assume(np.hypot(*pose.points[-1]) < 0.9)  # a straight arm has no way outwards
    angle = np.random.default_rng(seed).uniform(-np.pi, np.pi)
    target = pose.points[-1] + 0.03 * np.array([np.cos(angle), np.sin(angle)])
    pull = [Term(pose.moving[-1], target - pose.points[-1], 1e3), Term(stepper.space.turns, np.zeros(24), 1e-2)]
    after = stepper.step(pose, pull)
    assert np.hypot(*(target - after.points[-1])) < 0.5 * np.hypot(*(target - pose.points[-1]))


def test_pressed_against_a_wall_the_arm_stays() -> None:
    """A pull straight into a wall that the tip cannot slide along ends in poses that hardly move and never touch."""
    scene = open_scene(3)
    pocket = shapely.LineString([(0.9, 0.03), (1.02, 0.03), (1.02, -0.03), (0.9, -0.03)])
    workspace = Workspace(scene.workspace.boundary, (Obstacle("pocket", PlaneShape(pocket)),))
    stepper, pose = make_stepper(Scene(scene.arm, workspace, np.zeros(24), np.zeros(24)))
    for _ in range(20):
        terms = [Term(pose.moving[-1], np.array([0.05, 0.0]), 1e3), Term(stepper.space.turns, np.zeros(24), 1e-3)]
        pose = stepper.step(pose, terms)
    assert pose.points[-1, 0] < 1.02 - scene.arm.radius
    assert wall_gaps(scene.arm, workspace, pose.points).min() >= SETTINGS.keep_share * MARGIN - 1e-9


@settings(max_examples=20)
@given(seed=seeds)
def test_rows_are_the_derivatives_of_the_gaps(seed: int) -> None:
    """Along a random direction the least gap to each near wall and the gap of each near pair change as the rows say."""
    scene = clutter(seed % 40, 30)
    stepper, pose = make_stepper(scene)
    h = 1e-6 * np.random.default_rng(seed).normal(size=len(pose.v))
    contacts = stepper.finder.find(pose.points)
    change = contact_rows(contacts, pose.moving) @ h
    before, after = (stepper.space.pose(pose.v + s * h).points for s in (-1.0, 1.0))
    numeric = 0.5 * np.diff(wall_gaps(scene.arm, scene.workspace, np.array([before, after])), axis=0)[0]
    links = [shapely.linestrings(np.stack((p[:-1], p[1:]), axis=1)) for p in (before, after)]
    for k in np.unique(contacts.wall[contacts.second == WALL]):
        least = np.flatnonzero((contacts.wall == k) & (contacts.second == WALL))
        least = least[np.argmin(contacts.gap[least])]
        assert change[least] == pytest.approx(numeric[k], abs=1e-4 * np.abs(h).max() + 1e-12)
    for c in np.flatnonzero(contacts.second != WALL):
        i = contacts.first[c]
        j = contacts.second[c]
        pair = 0.5 * (links[1][i].distance(links[1][j]) - links[0][i].distance(links[0][j]))
        assert change[c] == pytest.approx(pair, abs=1e-4 * np.abs(h).max() + 1e-12)


@settings(max_examples=20)
@given(seed=seeds)
def test_normal_equations_solve_the_least_squares(seed: int) -> None:
    """The minimiser of the assembled quadratic is that of the weighted terms, by LAPACK."""
    rng = np.random.default_rng(seed)
    terms = [
        Term(rng.normal(size=(9, 5)), rng.normal(size=9), rng.uniform(0.1, 2.0, 9)),
        Term(rng.normal(size=(3, 5)), rng.normal(size=3), 0.7),
    ]
    hessian, gradient = normal_equations(terms, SETTINGS.ridge)
    root = [np.sqrt(np.broadcast_to(t.weight, len(t.target))) for t in terms]
    rows = np.vstack([w[:, None] * t.rows for w, t in zip(root, terms, strict=True)])
    target = np.concatenate([w * t.target for w, t in zip(root, terms, strict=True)])
    expected = np.linalg.lstsq(rows, target, rcond=None)[0]
    np.testing.assert_allclose(np.linalg.solve(hessian, -gradient), expected, atol=1e-6)


def test_smoothness_alone_straightens_the_arm() -> None:
    """With nothing else to do the arm loses its curvature step by step."""
    stepper, pose = make_stepper(open_scene(4))
    bends = [np.abs(pose.q[1:]).max()]
    for _ in range(60):
        pose = stepper.step(pose, [Term(stepper.space.turns, np.zeros(24), 1e-8)])
        bends.append(np.abs(pose.q[1:]).max())
    assert bends[-1] < 0.1 * bends[0]


def test_no_contact_means_nothing_to_allow() -> None:
    """With nothing near, any share is kept and no shortfall is allowed."""
    stepper, pose = make_stepper(Scene(make_arm(4, 0.0), open_scene(0).workspace, np.zeros(4), np.zeros(4)))
    contacts = stepper.finder.find(pose.points)
    assert len(contacts) == 0
    assert allowed_shortfall(contacts, SETTINGS.keep_share) == 0.0
    assert keeps_clear(contacts, 0.0, SETTINGS.keep_share)
    assert contacts.shortfall() == -np.inf
