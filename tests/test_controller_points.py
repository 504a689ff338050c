"""The points for a controller: by its own rules between them, no limit is passed and no wall comes nearer."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.controller_points import controller_points, message_checks, spared, trajectory_texts
from ccm_opt.io.reading import parse_problem
from ccm_opt.io.text_agreement import text_checks
from ccm_opt.problem.solution import JointTrajectory
from ccm_opt.verification.interpolated_message import Message, _effort_bow, _Steps, check_message_limits
from ccm_opt.verification.newton_euler import drive_efforts
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION

from .arms import plain_arm
from .corruption.plans import Folder, write_plans
from .promises import in_space
from .promises.cases import FULL, LINKS, Case, fed, fixed

SEEDS = st.integers(0, 2**32 - 1)


def as_the_controller_does(points: list[Mapping[str, FloatArray]], now: float) -> tuple[FloatArray, ...]:
    """Position, velocity and acceleration at a time between the first point and the last, [rad] and its rates.

    The rules of ``interpolate_between_points`` in ros2_controllers, ``joint_trajectory_controller/src/trajectory.cpp``:
    linear without velocities at both points, cubic with velocities alone, quintic with accelerations too.
    """
    times = [float(point["time"]) for point in points]
    k = min(max(int(np.searchsorted(times, now, side="right")) - 1, 0), len(times) - 2)
    first, last = points[k], points[k + 1]
    fields = ["positions"]
    for field in ("velocities", "accelerations"):
        if field not in first or field not in last:
            break
        fields.append(field)
    count = 2 * len(fields)
    # What a polynomial of this degree has at both points is asked for, and solved.
    rows = [_derivative_row(count, order, t) for t in (0.0, times[k + 1] - times[k]) for order in range(len(fields))]
    wanted = [point[field] for point in (first, last) for field in fields]
    polynomial = np.linalg.solve(np.array(rows), np.array(wanted))
    return tuple(_derivative_row(count, order, now - times[k]) @ polynomial for order in range(3))


def _derivative_row(count: int, order: int, t: float) -> FloatArray:
    coefficients = np.eye(count)
    return np.array(
        [
            np.polynomial.Polynomial(row).deriv(order)(t) if order else np.polynomial.Polynomial(row)(t)
            for row in coefficients
        ]
    )


def points_of(text: str) -> tuple[list[str], list[dict[str, FloatArray]]]:
    """Names and points of a message, read by PyYAML."""
    yaml = pytest.importorskip("yaml")
    loaded = yaml.safe_load(text)
    points = []
    for point in loaded["points"]:
        stamp = point.pop("time_from_start")
        points.append({name: np.array(values) for name, values in point.items()})
        points[-1]["time"] = np.array(stamp["sec"] + 1e-9 * stamp["nanosec"])
    return loaded["joint_names"], points


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Folder]:
    """Plans with pauses and limits on points, with limited jerk, with a feed axis, and in space."""
    return write_plans(tmp_path_factory.mktemp("plans"), ("pausing", "smooth", "fed", "fed in space"))


@pytest.mark.drawn(1)
@pytest.mark.parametrize("name", ["pausing", "smooth", "fed", "fed in space"])
def test_no_limit_is_passed_as_the_controller_interpolates(written: Mapping[str, Folder], name: str) -> None:
    """On a grid of 1 kHz velocities, accelerations, and efforts by Pinocchio of the URDF, keep their limits."""
    pin = pytest.importorskip("pinocchio")
    folder = written[name]
    problem = folder.solution.problem
    names, points = points_of(folder.texts["trajectory.yaml"])
    assert all(set(point) == set(points[0]) for point in points)
    assert ("accelerations" in points[0]) == (problem.limits.jerk is not None)
    times = np.append(np.arange(0.0, points[-1]["time"], 1e-3), points[-1]["time"])
    q, v, a = (np.array(values) for values in zip(*(as_the_controller_does(points, t) for t in times), strict=True))
    limits = problem.limits.of_drives(problem.arm.coordinates)
    drives = np.roll(np.arange(len(names)), len(problem.arm.base_axes))  # the axis is the first of the joints here
    axes = [*range(len(limits.velocity) - len(problem.arm.base_axes), len(limits.velocity))]
    order = [*axes, *range(3 * problem.arm.links)]
    assert len(drives) == len(order)
    assert np.max(np.abs(v) / limits.velocity[order]) <= 1.0
    assert np.max(np.abs(a) / limits.acceleration[order]) <= 1.0

    model = pin.buildModelFromXML(folder.texts["arm.urdf"])
    model.gravity = pin.Motion(problem.simulation.gravity, np.zeros(3))
    places = [names.index(joint) for joint in list(model.names)[1:]]
    data = model.createData()
    efforts = np.array([pin.rnea(model, data, *(x[k][places] for x in (q, v, a))).copy() for k in range(len(times))])
    geared = np.broadcast_to(problem.arm.rotor_inertia, (3 * problem.arm.links,))
    rubbed = np.broadcast_to(problem.arm.friction, (3 * problem.arm.links,))
    joints = efforts[:, len(axes) :] + geared * a[:, places][:, len(axes) :] + rubbed * v[:, places][:, len(axes) :]
    assert np.max(np.abs(joints) / limits.effort[: 3 * problem.arm.links]) <= 1.0
    assert np.all(np.abs(efforts[:, : len(axes)]) <= limits.effort[axes])


@pytest.mark.parametrize("name", ["pausing", "smooth", "fed", "fed in space"])
def test_files_have_a_tenth_of_the_samples(written: Mapping[str, Folder], name: str) -> None:
    """Points are few, and every pose between them is near one of the plan."""
    folder = written[name]
    plan = folder.solution.trajectory
    _, points = points_of(folder.texts["trajectory.yaml"])
    assert len(points) <= 0.15 * len(plan.time)
    assert len(folder.texts["trajectory.csv"].splitlines()) == 1 + len(points)


def smooth_message(rng: np.random.Generator, joints: int, *, quintic: bool) -> Message:
    """Points at random times with random states."""
    arm = plain_arm(joints)
    time = np.cumsum(np.append(0.0, rng.uniform(0.02, 0.2, 5)))
    states = [size * rng.standard_normal((6, joints)) for size in (0.3, 0.5, 2.0)]
    return Message(time, states[0], states[1], states[2] if quintic else None, arm.coordinates)


@given(SEEDS, st.booleans())
@settings(max_examples=30)
def test_curves_and_their_bounds_are_the_controllers(seed: int, quintic: bool) -> None:
    """What the verifier takes for the curve is that of the controller's rules, and its bounds hold everywhere on it."""
    rng = np.random.default_rng(seed)
    message = smooth_message(rng, 4, quintic=quintic)
    points = [
        {"time": message.time[k], "positions": message.positions[k], "velocities": message.velocities[k]}
        | ({"accelerations": message.accelerations[k]} if message.accelerations is not None else {})
        for k in range(6)
    ]
    steps = _Steps.from_message(message)
    bounds = [steps.greatest(order) for order in range(3)]
    for k in rng.integers(0, len(steps.segments), 12):
        now = message.time[steps.segments[k]] + steps.since[k] + rng.uniform() * steps.length[k]
        wanted = as_the_controller_does(points, now)
        for order in range(3):
            found = message.at_times(np.array([now]), order)[0]
            np.testing.assert_allclose(found, wanted[order], rtol=1e-8, atol=1e-8 * 10.0 ** (2 * order))
            assert np.all(np.abs(found) <= bounds[order][k] * (1.0 + 1e-9) + 1e-12)


@given(SEEDS, st.booleans(), st.booleans())
@settings(max_examples=20)
def test_what_efforts_do_between_looks_is_within_the_bound(seed: int, quintic: bool, in_3d: bool) -> None:
    """In the plane and in space second differences of efforts, of fast and long steps too, keep below it."""
    rng = np.random.default_rng(seed)
    case = in_space.fixed() if in_3d else fixed()
    problem = case.problem
    arm = replace(problem.arm, payload=0.2, friction=0.1, rotor_inertia=0.01)
    problem = replace(problem, arm=arm)
    columns = len(arm.coordinates)
    time = np.array([0.0, 0.1])
    states = [size * rng.standard_normal((2, columns)) for size in (0.5, 2.0, 5.0)]
    message = Message(time, states[0], states[1], states[2] if quintic else None, arm.coordinates)
    steps = _Steps.from_message(message)
    bow = _effort_bow(problem, steps)
    for k in rng.integers(0, len(bow), 5):
        at = steps.since[k] + steps.length[k] * np.array([0.0, 0.5, 1.0])
        segments = np.zeros(3, dtype=np.intp)
        torques, force = drive_efforts(
            arm, problem.simulation.gravity, *(message.at(segments, at, order) for order in range(3))
        )
        for values in (torques, force):
            bowed = np.abs(values[1] - 0.5 * (values[0] + values[2]))
            assert np.all(bowed <= steps.length[k] ** 2 / 8.0 * bow[k] + 1e-9)


def bang(limit: float, samples: int = 60) -> Case:
    """A motion at the limit of acceleration that turns to braking halfway between two samples."""
    case = fixed()
    half = (samples + 0.5) * 0.004
    time = np.append(0.004 * np.arange(2 * samples + 1), 2.0 * half)
    early = time <= half
    place = np.where(early, 0.5 * time**2, half**2 - 0.5 * (2.0 * half - time) ** 2)
    rate = np.where(early, time, 2.0 * half - time)
    way = np.linspace(1.0, 0.4, case.problem.arm.links)
    parts = [limit * values[:, None] * way for values in (place, rate, np.where(early, 1.0, -1.0))]
    case = case.limited(velocity=20.0, acceleration=limit, torque=50.0).asked(planner=FULL)
    return replace(case, trajectory=JointTrajectory(time, *parts))


def test_where_no_samples_will_do_time_is_longer() -> None:
    """A plan at its limits whose acceleration turns between two samples is handed on a little slower, and holds."""
    case = bang(2.0)
    found = controller_points(case.problem, case.trajectory, case.states, ())
    assert 1.0 < found.factor < 1.5
    limits, deviation = message_checks(case.problem, case.trajectory, found.message, found.samples, found.factor, 1e-3)
    assert limits.passed
    assert deviation.passed
    whole = replace(found, factor=1.0)
    assert not message_checks(
        case.problem,
        case.trajectory,
        Message(
            case.trajectory.time,
            *(getattr(case.trajectory, x) for x in ("positions", "velocities")),
            None,
            case.trajectory.coordinates,
        ),
        np.arange(len(case.trajectory.time)),
        whole.factor,
        1e-3,
    )[0].passed


def test_a_feed_that_leaves_the_end_of_its_range_gently_stays_in_it() -> None:
    """A cubic through far samples of a motion that sets off with the fourth power of time would first move back."""
    case = fed(0.08, 0.08)
    t = case.trajectory.time[:, None] / case.trajectory.time[-1]
    way, duration = case.trajectory.positions[-1], case.trajectory.time[-1]
    shape = (5.0 * t**4 - 4.0 * t**5, 20.0 * (t**3 - t**4) / duration, (60.0 * t**2 - 80.0 * t**3) / duration**2)
    positions, velocities, accelerations = (way * values for values in shape)
    case = case.moved(positions=positions, velocities=velocities, accelerations=accelerations)
    found = controller_points(case.problem, case.trajectory, case.states, ())
    assert found.factor == 1.0
    limits, deviation = message_checks(case.problem, case.trajectory, found.message, found.samples, 1.0, 1e-3)
    assert limits.passed
    assert deviation.passed


@given(SEEDS)
@settings(max_examples=10)
def test_no_pose_is_farther_from_the_plan_than_is_told(seed: int) -> None:
    """Every pose between points is within the deviation of some pose of the plan."""
    rng = np.random.default_rng(seed)
    case = fixed(rng.uniform(-0.8, 0.8, 6))
    plan = case.trajectory
    bent = plan.positions + 0.05 * np.sin(np.pi * plan.time / plan.time[-1])[:, None] ** 2 * rng.standard_normal(6)
    rates = np.gradient(bent, plan.time, axis=0)
    rates[[0, -1]] = 0.0
    plan = replace(plan, positions=bent, velocities=rates)
    samples = np.unique(np.append(rng.integers(1, len(plan.time) - 1, 12), [0, len(plan.time) - 1]))
    message = Message(plan.time[samples], bent[samples], rates[samples], None, plan.coordinates)
    told = message_checks(case.problem, plan, message, samples, 1.0, 1.0)[1].worst
    arm = case.problem.arm
    places = arm.joint_positions(arm.headings(np.concatenate((plan.positions[:-1], 0.5 * (bent[:-1] + bent[1:])))))
    piece = np.max(np.linalg.norm(np.diff(arm.joint_positions(arm.headings(bent)), axis=0), axis=2))
    for now in rng.uniform(0.0, plan.time[-1], 20):
        pose = arm.joint_positions(arm.headings(message.at_times(np.array([now]))))
        assert np.min(np.max(np.linalg.norm(places - pose, axis=2), axis=1)) <= told + piece


@pytest.mark.parametrize(("travel", "kept"), [(1e-8, True), (1e-5, False)])
def test_an_axis_between_points_leaves_its_range_by_rounding_at_most(travel: float, kept: bool) -> None:
    """A cubic from rest at the end of the range to a point with more than three times the mean velocity swings back."""
    problem = fed().problem
    problem = replace(problem, limits=replace(problem.limits, jerk=None, feed_jerk=None))
    positions = np.zeros((3, LINKS + 1))
    positions[1:, -1] = travel, 5.0 * travel
    rates = np.zeros((3, LINKS + 1))
    rates[1, -1] = 4.0 * travel / 0.01
    message = Message(np.array([0.0, 0.01, 0.03]), positions, rates, None, problem.arm.coordinates)
    check = check_message_limits(problem, message, [], DEFAULT_VERIFICATION)
    assert check.passed == kept
    assert kept or check.where.startswith("feed range")


FLUSH = {
    "in the plane": """
schema = 1
name = "flush"
[workspace]
bounds = [0.0, -1.0, 1.0, 1.0]
[arm]
links = 8
link_length = 0.1
radius = 0.02
base = [0.0, 0.0]
joint_limit_deg = 60.0
[limits]
velocity = 2.0
acceleration = 10.0
[start]
shape = "straight"
[goal]
position = [0.6, 0.3]
""",
}
FLUSH["in space"] = (
    FLUSH["in the plane"]
    .replace("schema = 1", "schema = 1\nspace = 3")
    .replace("[0.0, -1.0, 1.0, 1.0]", "[[0.0, -1.0, -1.0], [1.0, 1.0, 1.0]]")
    .replace("base = [0.0, 0.0]", "base = { position = [0.0, 0.0, 0.0] }")
    .replace("[0.6, 0.3]", "[0.6, 0.3, 0.1]")
)
FLUSH["touching at the start"] = FLUSH["in the plane"].replace(
    "[arm]", '[[workspace.obstacles]]\nname = "shelf"\nbox = [0.5, -0.5, 0.9, -0.02]\n[arm]'
)


@pytest.mark.drawn(1)
@pytest.mark.parametrize("name", FLUSH)
def test_what_touches_where_it_hardly_moves_is_handed_on(name: str) -> None:
    """An arm flush on a wall, or that leaves a shelf, has few points that pass; bent towards these they do not."""
    solution = ccm_opt.solve(parse_problem(FLUSH[name], "flush.toml"))
    motion = (solution.problem, solution.trajectory)
    found = controller_points(*motion, solution.joints, solution.checks)
    assert len(found.samples) < 0.3 * len(solution.trajectory.time)
    spare = spared(solution.problem, solution.checks)
    assert spare < 2e-6
    judged = (found.message, found.samples, found.factor, spare)
    assert all(check.passed for check in message_checks(*motion, *judged))
    # Down at the base, which brings the shelf and the wall nearer.
    bent = found.message.positions.copy()
    bent[1, 0 if name != "in space" else 1] -= 2e-4
    off = replace(found.message, positions=bent)
    _, deviation = message_checks(*motion, off, *judged[1:])
    assert not deviation.passed
    assert "wall clearance: link" in deviation.where


def test_quintics_through_accelerations_that_jump_are_refused(written: Mapping[str, Folder]) -> None:
    """The same points with the plan's accelerations, which a controller would join by quintics, pass the limits."""
    solution = written["pausing"].solution
    motion = (solution.problem, solution.trajectory)
    found = controller_points(*motion, solution.joints, solution.checks)
    limits, _ = message_checks(*motion, replace(found, smooth=True).message, found.samples, 1.0, 1.0)
    assert not limits.passed
    assert limits.worst > 1.3


def test_torques_between_points_are_held_against_their_limits() -> None:
    """A torque limit just below what the curve needs is passed, and one just above is not."""
    case = fixed(0.3 * np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0]))
    plan = case.trajectory
    samples = np.append(np.arange(0, len(plan.time) - 1, 20), len(plan.time) - 1)
    message = Message(plan.time[samples], plan.positions[samples], plan.velocities[samples], None, plan.coordinates)
    motion = JointTrajectory(plan.time, *(message.at_times(plan.time, order) for order in range(3)), plan.coordinates)
    peak = float(np.max(np.abs(replace(case, trajectory=motion).states.torques)))
    for share, passed in ((0.99, False), (1.01, True)):
        limited = case.limited(torque=share * peak).problem
        assert message_checks(limited, plan, message, samples, 1.0, 1.0)[0].passed == passed


def test_efforts_are_written_where_they_are_asked_for(written: Mapping[str, Folder]) -> None:
    """Controllers refuse points with efforts, so that only who asks gets them, and then they are the plan's."""
    solution = written["fed"].solution
    found = controller_points(solution.problem, solution.trajectory, solution.joints, solution.checks)
    plain, with_efforts = (trajectory_texts(found, effort=effort)[1] for effort in (False, True))
    assert plain == written["fed"].texts["trajectory.yaml"]
    assert "effort" not in plain
    assert re.sub(r"  effort: .*\n", "", with_efforts) == plain
    _, points = points_of(with_efforts)
    np.testing.assert_allclose(points[1]["effort"][1:], found.joints.torques[1], rtol=1e-11)


def test_a_message_may_be_slower_than_the_plan(written: Mapping[str, Folder], tmp_path: Path) -> None:
    """All times longer by one factor, with the rates that belong to it, is the same motion."""
    folder = written["pausing"].copy()
    solution = folder.solution
    found = controller_points(solution.problem, solution.trajectory, solution.joints, solution.checks)
    motion = found.trajectory
    slower = replace(motion, time=2.0 * motion.time, velocities=0.5 * motion.velocities)
    states = replace(found.joints, velocities=0.5 * found.joints.velocities)
    folder.texts["trajectory.yaml"] = trajectory_texts(replace(found, trajectory=slower, joints=states))[1]
    folder.write(tmp_path / "slower")
    checks = text_checks(tmp_path / "slower", solution.problem, solution.trajectory, solution.joints, solution.checks)
    assert all(check.passed for check in checks)
