"""Why arms of unequal links have no plan: the section that keeps them from it, by how much, and what would help."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, NoPlanFound
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.parameters import parameters_of
from ccm_opt.diagnosis.reach import joint_turns, most_turn
from ccm_opt.problem import Problem

from .space_arms import space_arm
from .test_unequal_links import unequal

RATES = {"velocity": 1.0, "acceleration": 4.0}
ROW = {"links": 6, "link_length": 0.05, "joint_limit_deg": 45}
THICK = ({"radius": 0.03}, {"radius": 0.012})
ROOM = (-0.9, -0.9, 0.9, 0.9)


def posed(rows: tuple[dict[str, Any], ...], goal: dict[str, Any], obstacles: dict[str, Any], **arm: Any) -> Problem:
    """A problem of an arm of sections at the origin of the plane."""
    given = {"sections": [{**ROW, **row} for row in rows], "base": (0.0, 0.0), **arm}
    return ccm_opt.make_problem("why", arm=given, obstacles=obstacles, limits=RATES, goal=goal, room=ROOM)


def ribs(half: float) -> dict[str, Any]:
    """Two ribs across the x axis with a gap between them."""
    return {"rib 1": {"box": (0.4, half, 0.42, 0.9)}, "rib 2": {"box": (0.4, -0.9, 0.42, -half)}}


def told(problem: Problem) -> Diagnosis:
    """Why the problem has no plan."""
    with pytest.raises(NoPlanFound) as error:
        ccm_opt.solve(problem)
    return error.value.diagnosis


def drawn(seed: int, *, in_space: bool) -> Problem:
    """A random arm of sections with a goal that it reaches in a pose that, like the start, touches no obstacle."""
    rng = np.random.default_rng(seed)
    rows = [
        {
            "links": int(rng.integers(2, 5)),
            "link_length": float(rng.uniform(0.03, 0.08)),
            "radius": float(rng.uniform(0.004, 0.03)),
            "joint_limit_deg": float(rng.uniform(5.0, 60.0)),
        }
        for _ in range(int(rng.integers(2, 4)))
    ]
    base: Any = {"position": (0.0, 0.0, 0.0)} if in_space else (0.0, 0.0)
    arm = {"sections": rows, "base": base, "base_limit_deg": float(rng.uniform(10.0, 180.0)), "self_collision": False}
    d = 3 if in_space else 2
    free = ccm_opt.make_problem(
        "free", arm=arm, limits=RATES, goal={"position": [0.1] * d}, room=None if in_space else ROOM
    )
    q = rng.uniform(-1.0, 1.0, len(free.arm.bend_limits)) * free.arm.bend_limits
    if rng.random() < 0.3:
        q = np.abs(q) ** 0.2 * free.arm.bend_limits**0.8
    points = [free.arm.joint_positions_at(each) for each in (q, np.zeros(len(q)))]
    bodies: dict[str, Any] = {}
    for k, place in enumerate(rng.uniform(-0.5, 0.5, (12, d))):
        gap = min(float(np.min(from_links(place, each) - free.arm.radii)) for each in points)
        if gap > 2e-3:
            radius = float(rng.uniform(0.3, 1.0)) * min(gap, 0.15)
            bodies[f"body {k}"] = {"sphere" if in_space else "circle": {"center": place.tolist(), "radius": radius}}
    goal: dict[str, Any] = {"position": points[0][-1].tolist(), "position_tolerance": 1e-4}
    if in_space and rng.random() < 0.5:
        goal["direction"] = (points[0][-1] - points[0][-2]).tolist()
    return ccm_opt.make_problem(
        "drawn", arm=arm, obstacles=bodies, limits=RATES, goal=goal, room=None if in_space else ROOM
    )


def from_links(place: FloatArray, points: FloatArray) -> FloatArray:
    """Distances of a place from the axes of links."""
    steps = np.diff(points, axis=0)
    shares = np.clip(np.sum((place - points[:-1]) * steps, axis=1) / np.sum(steps**2, axis=1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(place - points[:-1] - shares[:, None] * steps, axis=1))


@pytest.mark.drawn(20, of="dear tests")
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_no_goal_that_a_pose_reaches_is_proved_impossible(seed: int) -> None:
    """In the plane, whatever the sections, their limits, and obstacles beside the pose."""
    assert not [finding.reason for finding in failed(drawn(seed, in_space=False)) if finding.proved]


@pytest.mark.planning
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_no_goal_in_space_that_a_pose_reaches_is_proved_impossible(seed: int) -> None:
    """Likewise, with and without a direction at the goal."""
    assert not [finding.reason for finding in failed(drawn(seed, in_space=True)) if finding.proved]


@given(st.integers(0, 2**32 - 1), st.integers(2, 8))
@settings(max_examples=40, deadline=None)
def test_a_joint_turns_by_as_much_as_its_limits_allow(seed: int, links: int) -> None:
    """No bends within its limits turn it farther, and those of one limit as far as ``most_turn`` says."""
    arm = unequal(space_arm(links), seed)
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-1.0, 1.0, (2, 200)) * arm.bend_limits[:2, None]
    turns = joint_turns(arm)
    assert np.all(np.arccos(np.cos(a) * np.cos(b)) <= turns[0] + 1e-12)
    np.testing.assert_allclose(turns[1:], [most_turn(arm, limit) for limit in arm.bend_limits[2::2]])


def test_a_section_too_thick_for_a_gap_is_named() -> None:
    """The gap, the diameter, and the radius that passes; the thin section beyond is no cause."""
    found = failed(posed(({"radius": 0.03, "links": 9}, {"radius": 0.012}), {"position": (0.73, 0.0)}, ribs(0.02)))
    named = [finding for finding in found if finding.kind == "too thick"]
    assert len(named) == 1
    assert "section 1 is too thick for every way to within 0.300 m of the goal" in named[0].reason
    assert "between 'rib 1' and 'rib 2'" in named[0].reason
    assert named[0].bounds["arm.sections[0].radius"] == pytest.approx(0.02, rel=0.02)
    assert named[0].proved


def test_the_link_in_contact_is_named_with_its_section() -> None:
    """Only links that are thick enough touch; a radius of that section is tried, and helps."""
    post = {"post": {"circle": {"center": (0.1, 0.035), "radius": 0.01}}}
    diagnosis = told(posed(THICK, {"position": (0.5, 0.2)}, post))
    assert "link 2 of section 1 overlaps 'post' by 5.0 mm" in diagnosis.reason
    keys = [relaxed.key for relaxed in diagnosis.relaxations]
    assert "arm.sections[0].radius" in keys
    beside = {"post": {"circle": {"center": (0.45, 0.035), "radius": 0.01}}}
    assert not failed(posed(THICK, {"position": (0.5, 0.2)}, beside))


def test_an_arm_too_short_is_helped_by_either_section() -> None:
    """By the length of its links, which then add up to what is needed."""
    problem = posed(THICK, {"position": (0.7, 0.1)}, {})
    (finding,) = [each for each in failed(problem) if each.kind == "too short"]
    for key in ("arm.sections[0].link_length", "arm.sections[1].link_length"):
        parameter = next(each for each in parameters_of(problem) if each.key == key)
        longer = parameter.write(problem, finding.bounds[key])
        assert longer.arm.length == pytest.approx(float(np.hypot(0.7, 0.1)) - 1e-3)
        assert not [each for each in failed(longer) if each.kind == "too short"]


def test_the_section_whose_joints_are_too_stiff_is_named() -> None:
    """With the limit of its joints that lets the arm turn to the goal."""
    rows = ({"radius": 0.02, "joint_limit_deg": 4}, {"radius": 0.01, "joint_limit_deg": 10})
    problem = posed(rows, {"position": (0.2, 0.45)}, {}, base_limit_deg=5)
    (finding,) = failed(problem)
    assert finding.kind == "too stiff"
    key = "arm.sections[0].joint_limit_deg"
    parameter = next(each for each in parameters_of(problem) if each.key == key)
    assert not failed(parameter.write(problem, 1.1 * finding.bounds[key]))
    assert failed(parameter.write(problem, 0.99 * finding.bounds[key]))


@pytest.mark.parametrize("key", ["radius", "link_length", "joint_limit_deg"])
def test_a_changed_section_has_the_value_and_others_keep_theirs(key: str) -> None:
    """So has the arm that is read with the value in its file."""
    rows = [{**ROW, **row} for row in THICK]
    problem = posed(THICK, {"position": (0.5, 0.2)}, {})
    parameter = next(each for each in parameters_of(problem) if each.key == f"arm.sections[1].{key}")
    changed = parameter.write(problem, 1.3 * parameter.read(problem)).arm
    rows[1] = {**rows[1], key: 1.3 * rows[1][key]}
    read = posed(tuple(rows), {"position": (0.5, 0.2)}, {}).arm
    for name in ("lengths", "radii", "bend_limits", "inertia_axial", "inertia_transverse"):
        np.testing.assert_allclose(getattr(changed, name), getattr(read, name), rtol=1e-12, err_msg=name)
