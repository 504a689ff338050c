"""The independent verifier: sound against a dense sweep, strict against tampering, exact in its dynamics."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import shapely
import shapely.affinity
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.problem import JointPose, Limits, Problem, SimulationOptions, TipGoal
from ccm_opt.problem.solution import Check, JointStates, JointTrajectory
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.frames import dh_table, joint_names, revolute_angles
from ccm_opt.robot.mapping import map_curve
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace
from ccm_opt.verification.chain_motion import ChainMotion
from ccm_opt.verification.consistency import check_form
from ccm_opt.verification.selfcollision import check_self_collision, far_along_arm, nearest_links, segment_distances
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION
from ccm_opt.verification.verifier import verify
from ccm_opt.verification.wall_clearance import CheckedSurfaces, check_free_side, check_walls

from .arms import joint_torques, plain_arm

ROOM = shapely.box(-3.0, -3.0, 3.0, 3.0)


def quintic(start: FloatArray, end: FloatArray, duration: float = 2.0, samples: int = 501) -> JointTrajectory:
    """A rest-to-rest motion on a straight line in joint space."""
    t = np.linspace(0.0, 1.0, samples)
    s = 10 * t**3 - 15 * t**4 + 6 * t**5, 30 * t**2 - 60 * t**3 + 30 * t**4, 60 * t - 180 * t**2 + 120 * t**3
    bends, rates, growth = (value[:, None] * (end - start) for value in s)
    return JointTrajectory(t * duration, start + bends, rates / duration, growth / duration**2)


def make_states(problem: Problem, trajectory: JointTrajectory) -> JointStates:
    """The revolutes' view of a planar motion."""
    planar = trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations
    torques = joint_torques(problem.arm, problem.simulation.gravity, *planar)
    return JointStates(joint_names(problem.arm), *(revolute_angles(problem.arm, v) for v in planar), torques)


def make_case(
    arm: Arm | None = None,
    obstacles: Iterable[Obstacle] = (),
    start: FloatArray | None = None,
    end: FloatArray | None = None,
    **changes: Any,
) -> tuple[Problem, JointTrajectory, JointStates]:
    """A problem and a motion that solves it when no obstacle is in the way."""
    arm = arm or plain_arm()
    start = np.zeros(arm.links) if start is None else start
    end = np.full(arm.links, 0.2) if end is None else end
    one = np.ones(3 * arm.links)
    values = {"workspace": Workspace(ROOM, tuple(obstacles)), "limits": Limits(2.0 * one, 10.0 * one, 20.0 * one)}
    values |= {"start": JointPose(start), "goal": JointPose(end)}
    problem = Problem(name="case", arm=arm, **(values | changes))
    trajectory = quintic(start, end)
    return problem, trajectory, make_states(problem, trajectory)


def failures(checks: Iterable[Check]) -> set[str]:
    """Names of the checks that do not hold."""
    return {check.name for check in checks if not check.passed}


def named(checks: Iterable[Check], name: str) -> Check:
    """The check of that name."""
    return next(check for check in checks if check.name == name)


def straight_steps(bends: Any) -> tuple[FloatArray, FloatArray]:
    """A motion with given poses as samples, for the geometric checks alone."""
    bends = np.asarray(bends, dtype=np.float64)
    return 0.005 * np.arange(len(bends)), bends


def test_a_good_motion_passes_every_check() -> None:
    """A smooth motion in an empty room is accepted, and every promise is among the checks."""
    checks = verify(*make_case())
    assert not failures(checks)
    names = {check.name for check in checks}
    assert {"free side", "wall clearance", "self-collision", "joint limit", "joint velocity", "joint torque"} <= names
    assert {"joint acceleration", "rest", "start joints", "goal joints", "torques against dynamics"} <= names


@pytest.mark.parametrize(("share", "passes"), [(1.0, True), (1.0 + 1e-6, False)])
def test_samples_may_be_as_far_apart_as_the_format_promises(share: float, *, passes: bool) -> None:
    """Rounding of their times counts for nothing, however late they are; a step any longer is refused."""
    problem, _, _ = make_case(end=np.zeros(6))
    time = share * DEFAULT_VERIFICATION.largest_step * np.arange(2000)
    still = np.zeros((2000, 6))
    trajectory = JointTrajectory(time, still, still, still)
    assert np.max(np.diff(time)) > share * DEFAULT_VERIFICATION.largest_step
    check = check_form(problem, trajectory, make_states(problem, trajectory), DEFAULT_VERIFICATION)
    assert check.passed is passes


@pytest.mark.parametrize("place", range(4))
def test_arguments_of_another_type_are_refused_at_once(place: int) -> None:
    """Problem, motion, drives and settings: what was given instead is told, whichever it is."""
    arguments: list[Any] = [*make_case(), DEFAULT_VERIFICATION]
    arguments[place] = "a word"
    with pytest.raises(ProblemError, match="got str 'a word'"):
        verify(*arguments)


# ---------------------------------------------------------------- soundness


def random_motion(rng: np.random.Generator, links: int) -> tuple[FloatArray, FloatArray]:
    """A few random poses, near each other, for one small arm."""
    start = rng.uniform(-0.5, 0.5, links) * rng.uniform(0.2, 1.5)
    return straight_steps(start + np.cumsum(np.vstack((np.zeros(links), rng.normal(0.0, 0.12, (3, links)))), axis=0))


def random_obstacles(rng: np.random.Generator) -> tuple[Obstacle, ...]:
    """Polygons, circles and walls around the arm."""
    obstacles = []
    for k in range(6):
        centre = rng.uniform(-0.7, 0.7, 2)
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, 5))
        ring = centre + rng.uniform(0.02, 0.12) * np.stack((np.cos(angle), np.sin(angle)), axis=1)
        core = (shapely.Polygon(ring), shapely.Point(centre), shapely.LineString(ring[:3]))[k % 3]
        obstacles.append(Obstacle(f"obstacle {k}", PlaneShape(core, (0.0, 0.05, 0.01)[k % 3])))
    return tuple(obstacles)


@dataclass(frozen=True)
class Sweep:
    """1000 poses of a motion, measured by shapely and nothing of the verifier."""

    arm: Arm
    points: FloatArray

    @classmethod
    def of(cls, arm: Arm, bends: FloatArray) -> "Sweep":
        """Poses at equal parts of the motion."""
        u = np.linspace(0.0, len(bends) - 1.0, 1000)
        poses = np.stack([np.interp(u, np.arange(len(bends)), column) for column in bends.T], axis=1)
        return cls(arm, arm.joint_positions(arm.headings(poses)))

    def walls(self, workspace: Workspace) -> float:
        """Least gap to a wall."""
        arms = shapely.linestrings(self.points)
        gaps = [float(np.min(shapely.distance(arms, wall.core))) - wall.rounding for wall in workspace.walls]
        return min(gaps) - self.arm.radius

    @property
    def own(self) -> float:
        """Least gap between distant links."""
        links = shapely.linestrings(np.stack((self.points[:, :-1], self.points[:, 1:]), axis=2))
        pairs = zip(*self.arm.distant_pairs, strict=True)
        least = min((float(np.min(shapely.distance(links[:, i], links[:, j]))) for i, j in pairs), default=np.inf)
        return least - 2.0 * self.arm.radius

    @property
    def step(self) -> float:
        """Bound on what a gap to a wall can change between two poses."""
        return 2.0 * float(np.max(np.linalg.norm(np.diff(self.points, axis=0), axis=2)))


def judge(*, passed: bool, gap: float, limit: float, step: float, bodiless: bool) -> tuple[bool, str]:
    """A verdict beside what the sweep says: hit, clear, or too close to say."""
    hit = gap == 0.0 if bodiless else gap < limit - DEFAULT_VERIFICATION.contact_tolerance
    return passed, "hit" if hit else "clear" if gap > limit + step else "close"


def wall_outcome(seed: int, radius: float) -> tuple[bool, str]:
    """Verdict of the verifier against the dense sweep for one random motion."""
    rng = np.random.default_rng(seed)
    arm = plain_arm(6, 0.1, radius)
    workspace = Workspace(ROOM, random_obstacles(rng), clearance=0.1 * radius)
    time, bends = random_motion(rng, arm.links)
    motion, sweep = ChainMotion(arm, time, bends), Sweep.of(arm, bends)
    gap = sweep.walls(workspace)
    side, clear = check_free_side(motion, workspace), check_walls(motion, workspace)
    passed = side.passed and clear.passed
    if passed and gap < arm.link_length:
        assert clear.worst == pytest.approx(gap, abs=2e-4)
    return judge(passed=passed, gap=gap, limit=workspace.clearance, step=sweep.step, bodiless=radius == 0.0)


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize(("radius", "count"), [(0.02, 100), (0.0, 80)])
def test_walls_are_sound_and_not_shy(radius: float, count: int) -> None:
    """Of many random motions none that hits in a dense sweep passes, none clear in it is refused; both are frequent."""
    outcomes = Counter(wall_outcome(seed, radius) for seed in range(count))
    assert outcomes[True, "hit"] == outcomes[False, "clear"] == 0
    assert outcomes[True, "clear"] > count // 5
    assert outcomes[False, "hit"] > count // 10


def self_outcome(seed: int, radius: float) -> tuple[bool, str]:
    """Verdict on self-collision against the dense sweep for one random coiling motion."""
    rng = np.random.default_rng(seed)
    arm = plain_arm(8, 0.1, radius)
    start = rng.uniform(0.4, 0.95) * rng.choice([-1.0, 1.0]) + rng.normal(0.0, 0.15, arm.links)
    time, bends = straight_steps(start + np.cumsum(rng.normal(0.0, 0.06, (4, arm.links)), axis=0))
    check, sweep = check_self_collision(ChainMotion(arm, time, bends)), Sweep.of(arm, bends)
    return judge(passed=check.passed, gap=sweep.own, limit=0.0, step=2.0 * sweep.step, bodiless=radius == 0.0)


@pytest.mark.drawn(1)
@pytest.mark.planning
@pytest.mark.parametrize("radius", [0.02, 0.0])
def test_self_collision_is_sound_and_not_shy(radius: float) -> None:
    """Likewise for links against links."""
    outcomes = Counter(self_outcome(seed, radius) for seed in range(80))
    assert outcomes[True, "hit"] == outcomes[False, "clear"] == 0
    assert outcomes[True, "clear"] > 13
    assert outcomes[False, "hit"] > 6


@pytest.mark.parametrize("links", range(1, 6))
def test_an_arm_too_short_to_meet_itself_has_no_nearest_links(links: int) -> None:
    """Links have a nearest pair just where two of them are distant along the arm."""
    arm = plain_arm(links)
    time, bends = straight_steps(np.zeros((3, links)))
    assert (nearest_links(ChainMotion(arm, time, bends)) is None) is (not arm.distant_links.any())


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_segment_distances_agree_with_geos(seed: int) -> None:
    """Own segment distances equal shapely's, touching, crossing and pointlike segments included."""
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.integers(-3, 4, (4, 50, 2)).astype(float) + (seed % 2) * rng.normal(0.0, 0.3, (4, 50, 2))
    lines = shapely.linestrings(np.stack((a, b), axis=1)), shapely.linestrings(np.stack((c, d), axis=1))
    points = np.all(a == b, axis=1), np.all(c == d, axis=1)
    lines = tuple(np.where(p, shapely.points(e), line) for p, e, line in zip(points, (a, c), lines, strict=True))
    np.testing.assert_allclose(segment_distances(a, b, c, d), shapely.distance(*lines), atol=1e-12)


# ---------------------------------------------------------------- tampering


def test_tunnelling_through_a_thin_wall_is_refused() -> None:
    """A wall that lies wholly between two clear samples is found, with its name, the link and the time."""
    arm = plain_arm(2, 0.5, radius=0.001)
    wall = Obstacle("sliver", PlaneShape(shapely.LineString([(0.6, 0.05), (1.2, 0.1)])))
    time, bends = straight_steps([[-0.05, 0.0], [-0.02, 0.0], [0.17, 0.0], [0.2, 0.0]])
    workspace = Workspace(ROOM, (wall,))
    assert all(Sweep.of(arm, bends[[k, k]]).walls(workspace) > 0.0 for k in range(len(bends)))
    check = check_walls(ChainMotion(arm, time, bends), workspace)
    assert not check.passed
    assert "link 2 to 'sliver'" in check.where
    assert 0.005 < float(check.where.split("t = ")[1].split(" s")[0]) < 0.010


def test_a_bodiless_arm_may_not_cross_a_line() -> None:
    """With zero radius and a wall without thickness the crossing itself is found."""
    arm = plain_arm(4, 0.25, radius=0.0)
    wall = Obstacle("thread", PlaneShape(shapely.LineString([(0.8, 0.1), (1.5, 0.12)])))
    time, bends = straight_steps([[0.0, 0, 0, 0], [0.3, 0, 0, 0]])
    assert not check_walls(ChainMotion(arm, time, bends), Workspace(ROOM, (wall,))).passed
    assert check_walls(ChainMotion(arm, time, -bends), Workspace(ROOM, (wall,))).passed


def test_touching_within_a_micrometre_is_allowed_and_beyond_it_refused() -> None:
    """A gap may be short by the stated contact tolerance, and by no more."""
    arm = plain_arm(2, 0.5, radius=0.05)
    time, bends = straight_steps(np.zeros((3, 2)))
    for short, passed in ((0.0, True), (0.9e-6, True), (1.1e-6, False)):
        wall = Obstacle("shelf", PlaneShape(shapely.box(0.2, 0.05 - short, 0.8, 0.5)))
        assert check_walls(ChainMotion(arm, time, bends), Workspace(ROOM, (wall,))).passed is passed


@pytest.mark.drawn(20, of="dear tests")
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=3, deadline=None)
def test_what_a_link_may_be_off_is_asked_of_its_own_gaps_alone(seed: int) -> None:
    """A link that may be off by more than its gap to a wall touches it; at another time, or another link, does not."""
    rng = np.random.default_rng(seed)
    arm = plain_arm(4, 0.1, radius=0.01)
    time, bends = straight_steps(np.linspace(np.zeros(4), np.full(4, rng.uniform(0.05, 0.2)), 6))
    gap = rng.uniform(1e-5, 0.01)
    wall = Workspace(ROOM, (Obstacle("shelf", PlaneShape(shapely.box(0.3, -0.5, 0.4, -0.01 - gap))),))
    exact = ChainMotion(arm, time, bends)
    for interval, link, by, passed in (
        (0, 3, -1e-7, True),
        (0, 3, 2e-6, False),
        (4, 3, 2e-6, True),
        (0, 1, 2e-6, True),
    ):
        off = np.zeros((5, 4))
        off[interval, link] = gap + by
        assert check_walls(replace(exact, deviation=off), wall).passed is passed


def test_what_links_may_be_off_counts_for_both_of_a_pair() -> None:
    """Links of a coil that is held touch where together they may be off by more than their gap."""
    arm = plain_arm(8, 0.1, 0.01)
    time, bends = straight_steps(np.full((4, 8), 0.7))
    motion = ChainMotion(arm, time, bends)
    near = check_self_collision(motion).place
    assert near is not None
    for share, passed in ((0.49, True), (0.51, False)):
        off = np.zeros((3, 8))
        off[1] = share * near.gap
        assert check_self_collision(replace(motion, deviation=off)).passed is passed


def test_the_mount_may_touch_walls_and_nothing_beyond_it_may() -> None:
    """Arm length up to mount_length is exempt, even across several links; the link after it is not."""
    block = Obstacle("block", PlaneShape(shapely.box(-0.1, -0.1, 0.24, 0.1)))
    time, bends = straight_steps(np.zeros((3, 6)))
    for mount, passed in ((0.265, True), (0.05, False), (0.255, False)):
        motion = ChainMotion(plain_arm(6, 0.1, 0.02, mount_length=mount), time, bends)
        check = check_walls(motion, Workspace(ROOM, (block,)))
        assert check.passed is passed
    assert "link 3 to 'block'" in check.where
    flush = ChainMotion(plain_arm(6, 0.1, 0.02, mount_length=0.26), time, bends)
    touching = check_walls(flush, Workspace(ROOM, (block,)))
    assert touching.passed
    assert touching.where.endswith("touches it where it leaves the mount; links beyond it keep 40.0 mm from 'block'")


def test_an_arm_outside_the_room_or_inside_an_obstacle_is_refused() -> None:
    """Clearance from edges alone is not enough: the arm must be on the right side of them."""
    time, bends = straight_steps(np.zeros((2, 2)))
    motion = ChainMotion(plain_arm(2, 0.1), time, bends)
    inside = Workspace(ROOM, (Obstacle("rock", PlaneShape(shapely.box(-1.0, -1.0, 1.0, 1.0))),))
    outside = Workspace(shapely.box(1.0, 1.0, 2.0, 2.0))
    for workspace, name in ((inside, "rock"), (outside, "workspace boundary")):
        assert check_walls(motion, workspace).passed
        check = check_free_side(motion, workspace)
        assert not check.passed
        assert name in check.where
        assert check.worst < 0.0


def test_one_sample_moved_into_a_wall_is_refused() -> None:
    """Moving a single sample is caught by the wall check and by the rates."""
    wall = Obstacle("shelf", PlaneShape(shapely.box(0.2, -0.5, 0.6, -0.05)))
    problem, trajectory, joints = make_case(obstacles=[wall])
    assert not failures(verify(problem, trajectory, joints))
    bends = trajectory.bend_angles.copy()
    bends[250, 0] -= 0.5
    refused = failures(verify(problem, replace(trajectory, positions=bends), joints))
    assert {"wall clearance", "velocities against angles", "revolutes against bends", "joint velocity"} <= refused


def test_a_self_crossing_is_refused_and_named() -> None:
    """An arm that rolls up into itself is refused; without self_collision it is not asked."""
    end = np.full(10, 1.1)
    case = make_case(plain_arm(10), end=end, goal=JointPose(end))
    check = named(verify(*case), "self-collision")
    assert not check.passed
    assert "link 1 to link " in check.where or "link 2 to link " in check.where or "to link 10" in check.where
    loose = replace(case[0], arm=plain_arm(10, self_collision=False))
    assert "self-collision" not in {check.name for check in verify(loose, *case[1:])}


@pytest.mark.parametrize(
    ("field", "names"),
    [
        ("velocities", {"velocities against angles", "revolutes against bends"}),
        ("accelerations", {"accelerations against velocities", "revolutes against bends"}),
    ],
)
def test_falsified_rates_are_refused(field: str, names: set[str]) -> None:
    """Rates scaled down to hide a limit do not match the angles."""
    problem, trajectory, joints = make_case(end=np.full(6, 1.9) * np.array([1, -1, 1, -1, 1, -1]))
    false = replace(trajectory, **{field: 0.5 * getattr(trajectory, field)})
    assert names <= failures(verify(problem, false, joints))


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 60))
def test_velocities_that_accelerations_explain_need_no_allowance_but_rounding(seed: int, count: int) -> None:
    """Steps of constant acceleration pass where nothing may stay unseen, and a step that gains more does not."""
    rng = np.random.default_rng(seed)
    problem, trajectory, _ = make_case()
    time = np.append(0.0, np.cumsum(rng.uniform(1e-4, 4.9e-3, count - 1)))
    value = np.tile(rng.uniform(-5.0, 5.0, problem.arm.links), (count, 1))
    speed = np.cumsum(np.diff(time, prepend=0.0)[:, None] * value, axis=0)
    seen = replace(trajectory, time=time, positions=speed, velocities=speed, accelerations=value)
    strict = replace(DEFAULT_VERIFICATION, unseen_share=0.0, unseen_floor=0.0)
    states = make_states(problem, seen)
    name = "accelerations against velocities"
    assert named(verify(problem, seen, states, strict), name).passed
    jump = np.where(np.arange(count) < count // 2, 0.0, 1e-9)[:, None]
    assert not named(verify(problem, replace(seen, velocities=speed + jump), states, strict), name).passed


def test_a_motion_too_fast_is_refused_even_when_every_report_agrees() -> None:
    """Rates reported at half their true values everywhere cannot hide a broken velocity limit."""
    end = np.full(6, 1.9) * np.array([1, -1, 1, -1, 1, -1])
    problem, trajectory, _ = make_case(end=end)
    slow = Limits(np.full(18, 1.0), np.full(18, 2.0))
    problem = replace(problem, limits=slow)
    false = replace(
        trajectory,
        velocities=0.5 * trajectory.velocities,
        accelerations=0.5 * trajectory.accelerations,
    )
    checks = verify(problem, false, make_states(problem, false))
    assert {"joint velocity", "joint acceleration"} <= failures(checks)
    assert named(checks, "joint velocity").worst == pytest.approx(1.9 * 1.875 / 2.0, rel=1e-3)


def test_falsified_torques_are_refused() -> None:
    """One torque off by a thousandth of the peak is caught, and its joint and time are named."""
    problem, trajectory, joints = make_case()
    torques = joints.torques.copy()
    torques[100, 4] += 1e-3 * np.max(np.abs(torques))
    check = named(verify(problem, trajectory, replace(joints, torques=torques)), "torques against dynamics")
    assert not check.passed
    assert check.where == "joint 2 (ball02_bend) at t = 0.4000 s"


def test_limits_name_the_joint_and_the_time() -> None:
    """Each limit that is passed is reported with worst value, limit, joint and time."""
    problem, trajectory, joints = make_case()
    peak = np.abs(joints.torques).max(axis=0)
    limits = replace(problem.limits, torque=np.where(np.arange(18) == 7, 0.5 * peak, 20.0))
    check = named(verify(replace(problem, limits=limits), trajectory, joints), "joint torque")
    assert not check.passed
    assert check.where.startswith("joint 3 (ball03_bend) at t = ")
    assert check.worst == pytest.approx(2.0 * check.limit)
    stiff = replace(problem, arm=plain_arm(joint_limit=0.1))
    check = named(verify(stiff, trajectory, joints), "joint limit")
    assert (check.passed, check.limit, check.worst) == (False, 0.1, pytest.approx(0.2))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: replace(t, time=t.time[:-1]), "shape"),
        (lambda t: replace(t, time=2.0 * t.time), "too far apart"),
        (lambda t: replace(t, time=t.time + 1.0), "starts at"),
        (lambda t: replace(t, time=t.time - 0.004 * (np.arange(len(t.time)) > 9)), "does not increase"),
        (lambda t: replace(t, velocities=t.velocities * np.nan), "not finite"),
    ],
)
def test_malformed_samples_are_refused_with_the_reason(
    change: Callable[[JointTrajectory], JointTrajectory], words: str
) -> None:
    """Wrong shapes, times or numbers end the verification with one clear reason."""
    problem, trajectory, joints = make_case()
    checks = verify(problem, change(trajectory), joints)
    assert not checks[0].passed
    assert words in checks[0].where
    assert len(checks) == 2


def test_wrong_joint_names_are_refused() -> None:
    """Revolutes under other names, or in another order, are refused."""
    problem, trajectory, joints = make_case()
    checks = verify(problem, trajectory, replace(joints, names=joints.names[::-1]))
    assert failures(checks) == {"joint names"}


# ---------------------------------------------------------------- ends


def test_start_rest_and_goal_are_checked() -> None:
    """A motion that starts elsewhere, moves at its end, or misses the goal is refused for that reason."""
    problem, trajectory, joints = make_case()
    arm = problem.arm
    headings = arm.headings(trajectory.bend_angles[-1])
    tip = arm.joint_positions(headings)[-1]
    good = TipGoal(tip + np.array([9e-4, 0.0]), heading=float(headings[-1]) + 4.0 * np.pi + 0.017)
    assert not failures(verify(replace(problem, goal=good), trajectory, joints))
    bad = TipGoal(tip + np.array([1.1e-3, 0.0]), heading=float(headings[-1]) + 0.018)
    assert failures(verify(replace(problem, goal=bad), trajectory, joints)) == {"goal position", "goal heading"}
    assert failures(verify(replace(problem, goal=JointPose(np.full(6, 0.22))), trajectory, joints)) == {"goal joints"}
    moved = replace(problem, start=JointPose(np.full(6, 2e-6)))
    assert failures(verify(moved, trajectory, joints)) == {"start joints"}
    cut = JointTrajectory(*(values[:251] for values in vars(trajectory).values() if isinstance(values, np.ndarray)))
    assert "rest" in failures(verify(problem, cut, make_states(problem, cut)))


@pytest.mark.parametrize("mapping", ["least-squares", "even-joints"])
def test_a_start_on_a_curve_accepts_its_mappings_and_nothing_far_from_it(mapping: Any) -> None:
    """An arm mapped on the start curve is accepted, the straight arm is not."""
    arm = plain_arm(12, 0.05)
    curve = Configuration.chain(
        arm.base, 0.0, [0.3, 0.3], [np.array([0.0, 3, 4, 3, 1]), np.array([1.0, -3, -4, -3, 0])]
    )
    start = map_curve(arm, curve, mapping)
    case = make_case(arm, start=start, end=0.5 * start)
    problem = replace(case[0], start=JointPose.along(arm, curve))
    assert not failures(verify(problem, *case[1:]))
    straight = make_case(arm, end=0.5 * start)
    assert failures(verify(problem, *straight[1:])) == {"start on the curve", "start tip"}


# ---------------------------------------------------------------- dynamics


def pinocchio_model(arm: Arm, gravity: FloatArray) -> tuple[Any, Any]:
    """The arm as Pinocchio joints along the DH table's axes, which the verifier never uses."""
    pin = pytest.importorskip("pinocchio")
    model = pin.Model()
    model.gravity.linear = gravity
    c, s = np.cos(arm.base_heading), np.sin(arm.base_heading)
    placement = pin.SE3(np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]]), np.array([arm.base[0], 0.0, arm.base[1]]))
    parent = 0
    for k, row in enumerate(dh_table(arm)):
        parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"j{k}")
        turn = pin.SE3(pin.utils.rotate("z", row.offset), np.array([0.0, 0.0, row.d]))
        placement = turn * pin.SE3(pin.utils.rotate("x", row.alpha), np.array([row.a, 0.0, 0.0]))
        if k % 3 == 2:
            along = placement.translation / arm.link_length
            axial, across, ball = arm.inertia_axial[k // 3], arm.inertia_transverse[k // 3], np.outer(along, along)
            inertia = across * np.eye(3) + (axial - across) * ball
            model.appendBodyToJoint(
                parent, pin.Inertia(arm.masses[k // 3], 0.5 * placement.translation, inertia), pin.SE3.Identity()
            )
    return pin, model


@pytest.mark.parametrize("axes", ["zyx", "zyz"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_inverse_dynamics_agree_with_pinocchio(axes: Any, seed: int) -> None:
    """The verifier's Newton-Euler equals Pinocchio's for planar motion under gravity in any direction."""
    rng = np.random.default_rng(seed)
    links = int(rng.integers(1, 9))
    positive = [rng.uniform(0.1, 1.0, links) for _ in range(3)]
    arm = plain_arm(links, 0.3, axes=axes, base=rng.normal(size=2), base_heading=float(rng.normal()))
    arm = replace(arm, masses=positive[0], inertia_axial=0.1 * positive[1], inertia_transverse=0.1 * positive[2])
    gravity = rng.normal(0.0, 9.0, 3)
    bends, rates, growth = rng.normal(0.0, 1.5, (3, 4, links))
    own = joint_torques(arm, gravity, bends, rates, growth)
    pin, model = pinocchio_model(arm, gravity)
    turned = (revolute_angles(arm, values) for values in (bends, rates, growth))
    oracle = np.array([pin.rnea(model, model.createData(), *row) for row in zip(*turned, strict=True)])
    np.testing.assert_allclose(own, oracle, rtol=1e-9, atol=1e-9)


def test_torque_checks_use_the_problems_gravity() -> None:
    """Torques computed under other gravity than the problem's are refused."""
    problem, trajectory, joints = make_case()
    moon = replace(problem, simulation=SimulationOptions(gravity=np.array([0.0, 0.0, -1.62])))
    assert failures(verify(moon, trajectory, joints)) == {"torques against dynamics"}


@given(st.floats(0.0, 0.2), st.floats(0.01, 0.3))
@settings(max_examples=50, deadline=None)
def test_the_first_distant_pair_follows_the_file_format(radius: float, l: float) -> None:
    """Links i and j keep apart exactly when (|i - j| - 1) l ≥ max(2 l, π r)."""
    first = int(np.argmax(np.append(far_along_arm(plain_arm(100, l, radius))[0], True)))
    reach = max(2.0 * l, np.pi * radius)
    assert (first - 1) * l >= reach * (1.0 - 1e-9)
    assert (first - 2) * l < reach * (1.0 + 1e-9)


def test_links_in_line_do_not_cross() -> None:
    """A straight arm in any direction keeps its links apart, though rounding puts their ends to either side."""
    arm, rng = plain_arm(24), np.random.default_rng(3)
    first, second = np.triu_indices(arm.links, 3)
    for angle in rng.uniform(-np.pi, np.pi, 1000):
        points = arm.joint_positions(np.full(arm.links, angle))
        apart = segment_distances(points[first], points[first + 1], points[second], points[second + 1])
        np.testing.assert_allclose(apart, (second - first - 1) * arm.link_length, atol=1e-12)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), vertices=st.integers(3, 400))
def test_boxes_of_boxes_contain_all_edges(seed: int, vertices: int) -> None:
    """Every edge is in one box of each level, grown by no less than its rounding."""
    rng = np.random.default_rng(seed)
    angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, vertices))
    ring = rng.uniform(0.5, 1.0) * np.column_stack((np.cos(angles), np.sin(angles)))
    shapes = (shapely.LineString(ring), shapely.Point(2.0, 0.0), shapely.box(3.0, 3.0, 4.0, 4.0))
    obstacles = tuple(Obstacle(f"wall {k}", PlaneShape(shape, 0.01 * k)) for k, shape in enumerate(shapes))
    surfaces = CheckedSurfaces.from_workspace(Workspace(shapely.box(-5.0, -5.0, 5.0, 5.0), obstacles))
    node = np.zeros(1, dtype=np.intp)
    while not np.all(surfaces.is_single(node)):
        place, child = surfaces.children(node)
        assert np.all(surfaces.low[node[place]] <= surfaces.low[child])
        assert np.all(surfaces.high[node[place]] >= surfaces.high[child])
        assert np.all(surfaces.rounding[node[place]] >= surfaces.rounding[child])
        node = child
    np.testing.assert_array_equal(node - surfaces.offsets[-2], np.arange(len(surfaces.owner)))
    assert len(surfaces.owner) == (vertices - 1) + 1 + 4 + 4


@given(seed=st.integers(0, 2**32 - 1), power=st.integers(-17, 20))
def test_what_no_coordinate_of_walls_exceeds_has_their_scale(seed: int, power: int) -> None:
    """Walls of a room that is any power of two as large exceed nothing but as much more, small ones too."""
    obstacles = random_obstacles(np.random.default_rng(seed))
    sizes = []
    for scale in (1.0, 2.0**power):
        scaled = [shapely.affinity.scale(each.core, scale, scale, origin=(0.0, 0.0)) for each in obstacles]
        room = shapely.box(-scale, -scale, scale, scale)
        surfaces = CheckedSurfaces.from_workspace(
            Workspace(room, tuple(Obstacle(f"wall {k}", PlaneShape(core)) for k, core in enumerate(scaled)))
        )
        coordinates = np.concatenate([shapely.get_coordinates(each) for each in (room, *scaled)])
        assert surfaces.size == np.abs(coordinates).max()
        sizes.append(surfaces.size)
    assert sizes[1] == sizes[0] * 2.0**power
