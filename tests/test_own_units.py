"""The size of a problem does not matter: plans, verdicts and proofs are those of the problem at any other size."""

import re
from dataclasses import fields, is_dataclass, replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.errors import NoPlanFound, ProblemFileError
from ccm_opt.core.length_words import long_length, place, short_length, words_for_unit
from ccm_opt.diagnosis.checks import failed
from ccm_opt.io.reading import parse_problem, problem_from_mapping
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.problem import Problem, VerificationOptions
from tests.conftest import SMALL_PROBLEM
from tests.corruption.plans_in_space import PAUSING as SPACE_TEXT
from tests.diagnosis_families import FAMILIES, make_case
from tests.resizing import resized
from tests.scenes import clutter
from tests.solved_problems import solved

FACTORS = st.floats(-5.0, 6.0).map(lambda exponent: 10.0**exponent)
EXTREMES = (1e-5, 1e6)
FED_TOUR = f"""{SMALL_PROBLEM.partition("[goal]")[0]}
[[goal]]
position = [0.37, 0.1]
[[goal]]
position = [0.32, -0.12]
"""
FED_TOUR = FED_TOUR.replace("links = 4", "links = 4\nfeed = { range = [0.0, 0.3], hole = 0.0 }").replace(
    "acceleration = 10.0", "acceleration = 10.0\nfeed_velocity = 0.1\nfeed_acceleration = 0.5"
)
"""An arm on a feed axis that stops on its way."""
PACKAGE = Path(ccm_opt.__file__).parent
PAGE = (
    (PACKAGE.parent / "docs" / "guarantees.md").read_text().split("\n## Size and tolerances")[1].split("\n## Which")[0]
)


def patient(problem: Problem) -> Problem:
    """The problem with time enough for a busy machine."""
    return replace(problem, planner=replace(problem.planner, time_limit=900.0))


def plan(problem: Problem) -> ccm_opt.Solution:
    """Its solution; without an explanation of failures, which would have its own clock."""
    return ccm_opt.solve(patient(problem), explain=False)


def same_plan(one: ccm_opt.Solution, other: ccm_opt.Solution, factor: float) -> None:
    """Assert that two plans are one, but for their size."""
    links = one.problem.arm.links
    assert one.path.candidate.split(",")[0] == other.path.candidate.split(",")[0]
    np.testing.assert_allclose(other.path.spline.c[:, :links], one.path.spline.c[:, :links], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(other.path.spline.c[:, links:] / factor, one.path.spline.c[:, links:], rtol=1e-9)
    np.testing.assert_allclose(other.trajectory.duration, one.trajectory.duration, rtol=1e-6)
    assert [check.name for check in one.checks] == [check.name for check in other.checks]
    gaps = [[check.worst for check in s.checks if check.name == "wall clearance"] for s in (one, other)]
    np.testing.assert_allclose(np.divide(gaps[1], factor), gaps[0], rtol=1e-3, atol=1e-4 * one.problem.arm.length)


@pytest.mark.drawn(1, of="sizes")
@settings(max_examples=3, deadline=None)  # plans each twice
@given(seed=st.integers(0, 10_000), factor=FACTORS)
def test_random_problems_have_the_same_plan_at_every_size(seed: int, factor: float) -> None:
    """Bends agree to a billionth of a radian; what has no plan has none at any size."""
    problem = clutter(seed, 8).problem()
    try:
        found = plan(problem)
    except NoPlanFound as failure:
        with pytest.raises(type(failure)):
            plan(resized(problem, factor))
        return
    same_plan(found, plan(resized(problem, factor)), factor)


@pytest.mark.drawn(1, of="sizes")
@pytest.mark.planning
@pytest.mark.parametrize(("name", "factor"), [("swan-neck", 1e-5), ("s-duct", 1e6), ("", 1e6)], ids=str)
def test_problems_of_the_package_have_the_same_plan_at_every_size(name: str, factor: float) -> None:
    """With torque limits, with a start along a curve, with a feed axis and stops: all of it scales."""
    found = solved(name) if name else plan(parse_problem(FED_TOUR))
    same_plan(found, plan(resized(found.problem, factor)), factor)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000), factor=FACTORS, obstacles=st.integers(0, 12))
def test_problems_are_one_and_the_same_in_their_own_units(seed: int, factor: float, obstacles: int) -> None:
    """Hardly a length is told apart by the rounding of the division, and then by one place of the grid."""
    problem = clutter(seed, obstacles).problem()
    here, there = (OwnUnits(each.arm.length).scaled(each) for each in (problem, resized(problem, factor)))
    assert here.arm.length == pytest.approx(1.0, rel=1e-10)
    assert here.arm.link_length == there.arm.link_length
    assert abs(here.arm.radius - there.arm.radius) <= 2.0**-36
    for one, other in zip(here.workspace.walls, there.workspace.walls, strict=True):
        assert one.core.equals_exact(other.core, 2.0**-35)
    assert here.arm.radius == pytest.approx(problem.arm.radius / problem.arm.length, abs=2.0**-36)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("factor", EXTREMES)
def test_proofs_hold_at_every_size(family: str, factor: float) -> None:
    """What is proved impossible is proved so at every size, with figures that have grown like the problem."""
    problem = problem_from_mapping(make_case(family, 3).data)
    here = failed(problem)
    there = failed(resized(problem, factor))
    assert here
    assert [finding.kind for finding in here] == [finding.kind for finding in there]
    for one, other in zip(here, there, strict=True):
        if one.unit == "m" and one.measured is not None:
            assert other.measured == pytest.approx(factor * one.measured, rel=1e-6)
        if "arm.radius" in one.bounds:
            assert other.bounds["arm.radius"] == pytest.approx(factor * one.bounds["arm.radius"], rel=1e-6)


@pytest.mark.drawn(1, of="sizes")
def test_the_static_question_has_one_answer() -> None:
    """The pose at the goal is the same at every size, its room and curve grown with the arm."""
    problem = clutter(3, 8).problem()
    one = ccm_opt.find_pose(problem)
    factor = EXTREMES[0]
    other = ccm_opt.find_pose(resized(problem, factor))
    np.testing.assert_allclose(other.bends, one.bends, rtol=0.0, atol=1e-9)
    assert other.pose.gap == pytest.approx(factor * one.pose.gap, rel=1e-6)
    assert other.curve.length == pytest.approx(factor * one.curve.length, rel=1e-9)


def test_words_are_in_metres_whatever_the_unit() -> None:
    """Inside the block a unit is so many metres, blocks add up, and outside all is as before."""
    assert short_length(0.0123) == "12.3 mm"
    with words_for_unit(2.0):
        assert long_length(0.5) == "1.000 m"
        with words_for_unit(0.001):
            assert short_length(1.0) == "2.0 mm"
            assert place((1.0, 0.0)) == "(0.002, 0) m"
        assert place((0.5, 1.0)) == "(1.000, 2.000) m"
    assert long_length(0.5) == "0.500 m"


def test_the_contact_tolerance_is_the_users() -> None:
    """It is a millionth of the arm unless the file says, goes through the record, and must be positive."""
    problem = parse_problem(SMALL_PROBLEM)
    assert problem.contact_tolerance == pytest.approx(1e-6 * problem.arm.length)
    asked = parse_problem(SMALL_PROBLEM + "[verification]\ncontact_tolerance = 2e-5\n")
    assert asked.contact_tolerance == 2e-5
    with pytest.raises(ProblemFileError, match=r"line \d+: verification\.contact_tolerance"):
        parse_problem(SMALL_PROBLEM + "[verification]\ncontact_tolerance = 0.0\n")
    assert plan(asked).checks
    with pytest.raises(ccm_opt.core.errors.ProblemError, match="contact_tolerance"):
        replace(problem, verification=VerificationOptions(-1.0))


@pytest.mark.parametrize("in_space", [False, True])
def test_no_plan_goes_through_walls_by_way_of_rounding(*, in_space: bool) -> None:
    """More than a thousandth of the arm may not be missing of a gap, in files and in problems made otherwise."""
    text = SPACE_TEXT if in_space else SMALL_PROBLEM
    problem = parse_problem(text)
    most = 1e-3 * problem.arm.length
    asked = parse_problem(f"{text}\n[verification]\ncontact_tolerance = {0.999 * most}\n")
    assert asked.contact_tolerance == pytest.approx(0.999 * most)
    for wrong in (1.001 * most, f"1{'0' * 400}"):
        with pytest.raises(ProblemFileError, match=r"line \d+: verification\.contact_tolerance"):
            parse_problem(f"{text}\n[verification]\ncontact_tolerance = {wrong}\n")
    with pytest.raises(ccm_opt.core.errors.ProblemError, match="a thousandth of the arm's length"):
        replace(problem, verification=VerificationOptions(1.001 * most))


def settings_modules() -> list[Path]:
    """Every module of the package that has a settings class."""
    return [
        path
        for path in sorted(PACKAGE.rglob("*.py"))
        if re.search(r"^class \w+Settings\b", path.read_text(), re.MULTILINE)
    ]


def settings_classes() -> dict[str, type]:
    """All settings classes of the package by name."""
    found: dict[str, type] = {}
    for path in settings_modules():
        module = import_module(".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts))
        found |= {name: each for name, each in vars(module).items() if is_dataclass(each) and isinstance(each, type)}
    return found


def test_every_tolerance_on_the_page_is_there_with_its_value() -> None:
    """The page of tolerances names fields that exist, with the values that they have."""
    classes = settings_classes()
    rows = re.findall(r"^\| `(\w+)\.(\w+)`(?!:)[^|]*\| (\S*) ?\|", PAGE, re.MULTILINE)
    assert len(rows) > 10
    for owner, name, value in rows:
        if owner in {"planner", "verification", "goal"}:
            continue
        default = {each.name: each.default for each in fields(classes[owner])}[name]
        assert not value or default == float(value), (owner, name)
    for module, name, value in re.findall(r"^\| `(\w+\.\w+)`: `(\w+)` \| (\S+) \|", PAGE, re.MULTILINE):
        assert getattr(import_module(f"ccm_opt.{module}"), name) == float(value), (module, name)


def test_no_setting_in_metres_is_missing_on_the_page() -> None:
    """Whatever settings class documents a number in metres, the page names it."""
    for owner, each in settings_classes().items():
        if owner.endswith("Settings"):
            for name, line in re.findall(r"^ +(\w+): (.*)$", each.__doc__ or "", re.MULTILINE):
                assert "[m]" not in line or name in PAGE, (owner, name)
