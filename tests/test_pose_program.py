"""The goal-pose NLP as data: its start keeps every equation, and each block of rows says what it should."""

from dataclasses import replace
from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.arrays import FloatArray
from ccm_opt.ik.bishop_shooting import BishopFrames
from ccm_opt.ik.goal_poses import carrier_rows, driven
from ccm_opt.ik.pose_program import PoseSize, pose_program
from ccm_opt.ik.pose_regions import JointRegions
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.pose_solver import PoseQuestion
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.base_axes import BaseAxis
from ccm_opt.robot.couplings import CoupledJoints
from tests.arc_arms import arc_arm
from tests.space_arms import FEED_OF_TESTS, planar_twin, turned_arm
from tests.space_clutter import curve_directions

SEEDS = st.integers(0, 2**32 - 1)
KINDS = pytest.mark.parametrize("kind", ["plane", "space", "axes", "coupled", "arcs"])
AXES = (
    BaseAxis(np.array([0.6, 0.0, 0.8]), -1.0, 1.0, revolute=False),
    BaseAxis(np.array([0.0, 1.0, 0.0]), -1.0, 1.0, revolute=True, point=np.array([0.1, 0.2, 0.3])),
    BaseAxis(np.array([0.0, 0.0, 1.0]), -1.0, 1.0, revolute=True, point=np.array([0.1, 0.2, 0.0])),
)
LINKS = 8
SEGMENTS = 2


def random_arm(random: np.random.Generator, kind: str, **changes: object) -> Arm:
    """An arm that lies anyhow: each joint of its own, two drives for all, or two sections that bend evenly."""
    if kind == "arcs":
        return arc_arm((3, 4), (0.4, 0.3), **changes)
    if kind == "axes":
        changes = {"carrier": AXES}
    arm = turned_arm(random, LINKS, **changes)
    if kind == "coupled":
        ratios = np.zeros((2 * LINKS, 2))
        ratios[::2, 0], ratios[1::2, 1] = random.uniform(0.2, 1.0, (2, LINKS))
        arm = replace(arm, coupled=CoupledJoints(ratios, ("drive1", "drive2"), arm.bend_limits, arm.lengths))
    return planar_twin(arm) if kind == "plane" else arm


def question(kind: str, seed: int, *, fed: bool = False, loaded: bool = False) -> PoseQuestion:
    """A pose at random with two sides beside each of two joints, through which it has a gap of 4 and of 6 mm."""
    random = np.random.default_rng(seed)
    arm = random_arm(random, kind, feed=FEED_OF_TESTS if fed else None)
    q = random.uniform(-0.3, 0.3, len(arm.coordinates))
    if kind in {"space", "axes"}:  # near a curve, which the offsets lead to
        curve = curve_directions(arm, 9)
        q[: len(arm.bend_limits)] = (curve @ random.normal(0.0, 0.3, curve.shape[1]))[: len(arm.bend_limits)]
    if arm.drives is not None:
        q[: 2 * LINKS] = arm.drives.coupling @ (0.5 * random.uniform(-1.0, 1.0) * arm.drives.drive_limits)
    q = np.clip(q, arm.lower_limits, arm.upper_limits)
    points, rotations = arm.joint_positions_at(q), arm.link_rotations(q)
    joint = np.array([3, 6])
    normals = rotations[joint, :, 1]
    offsets = np.sum(normals * points[joint], axis=1) - np.array([0.004, 0.006])
    regions = JointRegions(joint, normals, offsets, np.ones(2))
    gravity = np.full(arm.dimension, 3.0)
    bent_by = len(arm.bend_limits if arm.drives is None else arm.drives.drive_names)
    limits = np.full(bent_by, 5.0) if loaded else None
    built = pose_program(
        PoseSize(arm.dimension, LINKS, 2, SEGMENTS, loaded, (), (), (), *driven(arm), carrier_rows(arm))
    )
    return PoseQuestion(
        program=built,
        settings=PoseSettings(),
        weights=np.ones(len(built.parts)),
        arm=arm,
        position=points[-1],
        direction=rotations[-1, :, 0],
        near=q,
        start=q,
        regions=regions,
        wanted_gap=0.01,
        gravity=gravity,
        torque_limits=limits,
        roll=None,
        base_weights=np.ones(len(AXES)) if kind == "axes" else None,
    )


@KINDS
@given(seed=SEEDS, fed=st.booleans(), loaded=st.booleans())
@settings(max_examples=15, deadline=None)
def test_the_start_keeps_every_equation_and_has_the_gap_of_its_sides(
    kind: str, seed: int, fed: bool, loaded: bool
) -> None:
    """Splines, turns, frames, links, loads, points and goal fit together; what a pose has across its curve is left."""
    asked = question(kind, seed, fed=fed, loaded=loaded)
    built = asked.program
    function = ca.Function("rows", [built.variables, built.parameters.column], [built.constraints])
    rows = np.asarray(function(asked.start_values, asked.parameters), dtype=np.float64).ravel()
    lower, _ = built.bounds
    names = built.row_names
    equations = np.flatnonzero(built.bounds[0] == built.bounds[1])
    missed = {names[row]: rows[row] for row in equations if abs(rows[row] - lower[row]) > 1e-9}
    # In space the mapping has offsets, and the mean direction of the program is that of the frame's series.
    mapping = {name: value for name, value in missed.items() if name.startswith("mapping of link")}
    assert set(missed) == set(mapping)
    if built.frames.start_keeps_rows:
        assert all(abs(value) < 2e-3 for value in mapping.values())
    assert asked.start_values[-1] * asked.arm.length == pytest.approx(0.004)
    sides = [row for row, name in enumerate(names) if "side" in name or "knot" in name]
    assert np.min(rows[sides]) > -1e-9


@KINDS
def test_variables_stand_where_their_names_say(kind: str) -> None:
    """Places cover the column without gaps, each is as long as its symbols, and rows have names of their own."""
    built = question(kind, 1, loaded=True).program
    places = list(built.unknowns.places.values())
    assert places[0].start == 0
    assert places[-1].stop == built.variables.numel()
    assert all(before.stop == after.start for before, after in pairwise(places))
    values = ca.DM(range(built.variables.numel()))
    for name, symbols in built.unknowns.by_name.items():
        found = np.asarray(ca.Function("part", [built.variables], [ca.vec(symbols)])(values)).ravel()
        place = built.unknowns.places[name]
        np.testing.assert_array_equal(found, np.arange(place.start, place.stop))
    assert len(set(built.row_names)) == len(built.row_names)


@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_frames_of_the_series_are_those_of_the_curve(seed: int) -> None:
    """Shooting from link to link arrives where the curve's own integration does, to the order of its steps."""
    asked = question("space", seed)
    arm = asked.arm
    frames = asked.program.frames
    assert isinstance(frames, BishopFrames)
    values = frames.values(arm.bend_pairs(asked.start), np.zeros(1), None)
    curve = frames.curve(arm, values, asked.start)
    wanted, _ = curve.sample_frames(np.linspace(0.0, curve.length, LINKS + 1)[:-1])
    w, x, y, z = values["frames"].T
    along = np.stack((w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y)), axis=1)
    bend = float(np.max(np.linalg.norm(curve.curvature_at(np.linspace(0.0, curve.length, 100)), axis=1)))
    assert np.max(np.abs(along @ arm.base_rotation.T - wanted[..., 0])) < 0.05 * (bend * arm.link_length) ** 3 + 1e-9


@KINDS
@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_holding_torques_are_the_slopes_of_the_potential_energy(kind: str, seed: int) -> None:
    """What the joints bear is the derivative of the energy of all links and the payload by their bends."""
    asked = question(kind, seed, loaded=True)
    arm = asked.arm

    def energy(q: FloatArray) -> float:
        points = arm.joint_positions_at(q)
        centres = 0.5 * (points[1:] + points[:-1])
        return float(-(arm.masses @ (centres @ asked.gravity)) - arm.payload * points[-1] @ asked.gravity)

    bent = np.eye(len(arm.bend_limits)) if arm.drives is None else arm.drives.coupling.T
    steps = 1e-6 * np.hstack((bent, np.zeros((len(bent), len(arm.base_axes)))))
    slopes = np.array([(energy(asked.start + step) - energy(asked.start - step)) / 2e-6 for step in steps])
    shares = asked.start_values[asked.program.unknowns.places["torque shares"]]
    assert asked.torque_limits is not None
    np.testing.assert_allclose(shares * asked.torque_limits, -slopes, atol=1e-7)


@KINDS
def test_sides_that_say_nothing_are_kept_anywhere(kind: str) -> None:
    """Padding never binds, and a side of a pair asks for its share of the gap alone."""
    asked = question(kind, 0)
    sides = asked.padded_sides()
    assert sides["normals"].shape == (LINKS + 1, 2, asked.arm.dimension)
    said = np.any(sides["normals"] != 0.0, axis=2)
    assert said.sum() == 2
    assert np.all(sides["offsets"][~said] < -asked.wanted_gap / asked.arm.length)
    assert np.all(sides["gap shares"][~said] == 0.0)
    regions = asked.regions
    half = JointRegions(regions.joint, regions.normals, regions.offsets, np.array([0.5, 1.0]))
    points = asked.arm.joint_positions_at(asked.start)
    assert half.gap(asked.arm.free_shares, points) == pytest.approx(0.006)


def test_sides_of_a_link_hold_both_its_ends() -> None:
    """They belong to the joint before and to that behind, and are numbered joint by joint."""
    regions = JointRegions.of_links(np.array([1, 0]), np.eye(2), np.zeros(2), np.ones(2))
    np.testing.assert_array_equal(regions.joint, [1, 0, 2, 1])
    np.testing.assert_array_equal(regions.number, [0, 0, 0, 1])
    assert regions.most == 2
