"""The goal-pose NLP in space as data: its start keeps every equation, and each block of rows says what it should."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.holding import HoldingLoads, holding_loads
from ccm_opt.ik.pose_program import PoseSize
from ccm_opt.ik.pose_settings import SpacePoseSettings
from ccm_opt.ik.space_pose_program import SPACE_PARTS, SpacePoseProgram, space_pose_program
from ccm_opt.ik.space_pose_solver import CurveNumbers, SpacePoseQuestion, link_quaternions, start_values
from ccm_opt.ik.space_pose_task import LinkSides, SpacePoseTask
from ccm_opt.problem import TipGoal
from ccm_opt.robot.curve_space import CurveSpace
from tests.space_arms import FEED_OF_TESTS, turned_arm

SEEDS = st.integers(0, 2**32 - 1)
LINKS = 8
SETTINGS = SpacePoseSettings(segments=2)


def program() -> SpacePoseProgram:
    """Of a small arm, two sides a link."""
    return space_pose_program(PoseSize.from_settings(LINKS, 2, loaded=False, settings=SETTINGS))


def question(seed: int, *, fed: bool = False) -> SpacePoseQuestion:
    """A pose at random with two sides beside each of two links, through which it has a gap of 4 and of 6 mm."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, LINKS, feed=FEED_OF_TESTS if fed else None)
    space = CurveSpace.of(arm, 9)
    v = random.normal(0.0, 0.3, space.dimension)
    q = np.clip(space.configurations(v), arm.lower_limits, arm.upper_limits)
    points, rotations = arm.joint_positions_at(q), arm.link_rotations(q)
    link = np.array([3, 6])
    normals = rotations[link, :, 1]
    offsets = np.sum(normals * points[link], axis=1) - np.array([0.004, 0.006])
    sides = LinkSides(link, normals, offsets, np.ones(2))
    target = TipGoal(points[-1], rotations[-1, :, 0])
    task = SpacePoseTask(arm, target, q, q, sides, 0.01)
    return SpacePoseQuestion(program(), task, np.ones(len(SPACE_PARTS)), SETTINGS)


def rows_at(asked: SpacePoseQuestion, values: FloatArray) -> FloatArray:
    """All rows of the program at values of its variables."""
    function = ca.Function(
        "rows", [asked.program.variables, asked.program.parameters.column], [asked.program.constraints]
    )
    return np.asarray(function(values, asked._parameters()), dtype=np.float64).ravel()


@given(SEEDS, st.booleans())
@settings(max_examples=20, deadline=None)
def test_the_start_keeps_every_equation_and_has_the_gap_of_its_sides(seed: int, fed: bool) -> None:
    """Splines, turns, frames, links, points and goal fit together; what a pose has across its curve is its offset."""
    asked = question(seed, fed=fed)
    start = asked._start()
    lower, upper = asked.program.bounds
    rows = rows_at(asked, start)
    names = asked.program.row_names
    equations = np.flatnonzero(lower == upper)
    missed = {names[row]: rows[row] for row in equations if abs(rows[row] - lower[row]) > 1e-9}
    # The mean direction of the program is that of the frame's series, the oracle's an integral of the curve.
    mapping = {name: value for name, value in missed.items() if name.startswith("mapping of link")}
    assert set(missed) == set(mapping)
    assert all(abs(value) < 2e-3 for value in mapping.values())
    assert start[-1] * asked.task.arm.length == pytest.approx(0.004)
    assert np.min(rows[lower < upper]) > -1e-9


@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_frames_of_the_series_are_those_of_the_curve(seed: int) -> None:
    """Shooting from link to link arrives where the curve's own integration does, to the order of its steps."""
    asked = question(seed)
    arm = asked.task.arm
    near = CurveNumbers.near(arm, asked.task.start, SETTINGS.segments)
    values = start_values(arm, asked.task.start, near, asked.program.curve.parts[0].moment_scale)
    quaternions = values[asked.program.places["frames"]].reshape(LINKS, 4)
    curve = near.configuration(arm, 0.0)
    frames, _ = curve.frames_at(np.linspace(0.0, curve.length, LINKS + 1)[:-1])
    w, x, y, z = quaternions.T
    along = np.stack((w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y)), axis=1)
    bend = float(np.max(np.linalg.norm(curve.curvature_at(np.linspace(0.0, curve.length, 100)), axis=1)))
    assert np.max(np.abs(along @ arm.base_rotation.T - frames[..., 0])) < 0.05 * (bend * arm.link_length) ** 3 + 1e-9


def test_variables_stand_where_their_names_say() -> None:
    """Places cover the column without gaps, and each is as long as its symbols."""
    built = program()
    places = list(built.places.values())
    assert places[0].start == 0
    assert places[-1].stop == built.variables.numel()
    assert all(before.stop == after.start for before, after in pairwise(places))
    values = ca.DM(range(built.variables.numel()))
    for name, symbols in (("bends", built.bends), ("points", built.points), ("gap", built.gap), ("links", built.links)):
        found = np.asarray(ca.Function("part", [built.variables], [ca.vec(symbols)])(values)).ravel()
        place = built.places[name]
        np.testing.assert_array_equal(found, np.arange(place.start, place.stop))
    assert len(set(built.row_names)) == len(built.row_names)


@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_holding_torques_are_the_slopes_of_the_potential_energy(seed: int) -> None:
    """What the joints bear is the derivative of the energy of all links and the payload by their bends."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, LINKS, payload=0.3, masses=random.uniform(0.1, 0.3, LINKS))
    q = random.uniform(-0.6, 0.6, 2 * LINKS)
    gravity = random.normal(0.0, 5.0, 3)

    def energy(bends: FloatArray) -> float:
        points = arm.joint_positions_at(bends)
        centres = 0.5 * (points[1:] + points[:-1])
        return float(-(arm.masses @ (centres @ gravity)) - arm.payload * points[-1] @ gravity)

    steps = 1e-6 * np.eye(2 * LINKS)
    slopes = np.array([(energy(q + step) - energy(q - step)) / 2e-6 for step in steps])
    links = link_quaternions(arm.bend_pairs(q))
    points = (arm.joint_positions_at(q) - arm.base) @ arm.base_rotation / arm.length
    local = gravity @ arm.base_rotation
    weights = np.outer(arm.masses, local)
    payload = arm.payload * local
    moments, torques = holding_loads(links, points, weights, payload)
    np.testing.assert_allclose(torques.ravel() * arm.length, -slopes, atol=1e-7)

    # As variables of the program they are the same.
    limits = random.uniform(0.5, 2.0, (LINKS, 2))
    loads = HoldingLoads.symbols(LINKS)
    given = (links.T, points.T, weights.T, payload, limits.T)
    ties = loads.rows(*(ca.SX(ca.DM(each)) for each in given))[:2]
    missed = ca.Function("missed", [loads.variables], [ca.vertcat(*(block.expression for block in ties))])
    shares = torques / limits
    np.testing.assert_allclose(missed(np.concatenate((moments.ravel(), shares.ravel()))), 0.0, atol=1e-12)


def test_sides_that_say_nothing_are_kept_anywhere() -> None:
    """Padding never binds, and a side of a pair asks for its share of the gap alone."""
    asked = question(0)
    normals, offsets, shares = asked._padded_sides()
    assert normals.shape == (LINKS, 2, 3)
    said = np.any(normals != 0.0, axis=2)
    assert said.sum() == 2
    assert np.all(offsets[~said] < -asked.task.wanted_gap / asked.task.arm.length)
    assert np.all(shares[~said] == 0.0)
    sides = asked.task.sides
    half = LinkSides(sides.link, sides.normals, sides.offsets, np.array([0.5, 1.0]))
    points = asked.task.arm.joint_positions_at(asked.task.start)
    assert half.gap(asked.task.first_shares, points) == pytest.approx(0.006)
    assert half.joined(sides).most == 2
