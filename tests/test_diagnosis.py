"""Why there is no plan: the checks prove nothing false, the reason is the true one, what is said to help was solved."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import (
    Diagnosis,
    Finding,
    MotionNotFound,
    ProblemError,
    Relaxation,
    RetimingError,
    UnreachableGoal,
    sentences,
)
from ccm_opt.core.progress import Progress, Stages
from ccm_opt.diagnosis import explain
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.explain import explain_failure, refuse_impossible, suspected_causes
from ccm_opt.diagnosis.parameters import JOINT_LIMIT, LENGTH, MASS, PARAMETERS, RADIUS, TORQUE, Parameter
from ccm_opt.diagnosis.planar_axis_paths import planar_axis_paths
from ccm_opt.diagnosis.ranking import rank_findings
from ccm_opt.diagnosis.reach import least_chord, within_reach
from ccm_opt.diagnosis.relaxation import Trials, least_change, relaxations
from ccm_opt.driver.legs import recorded_path
from ccm_opt.io.reading import problem_from_mapping
from ccm_opt.problem import JointPose, Limits, Problem, TipGoal, Tolerances
from ccm_opt.problem.solution import JointPath
from ccm_opt.robot.base_axes import Feed
from ccm_opt.scene.workspace import Obstacle, PlaneShape, Workspace

from .diagnosis_families import FAMILIES, GRAVITY, Case, make_case, string_round
from .diagnosis_judgement import named_rightly, relaxation_error
from .scenes import Scene, clutter, later, make_arm, open_scene, random_headings
from .space_diagnosis_families import make_space_case


def ends_with(path: Path, data: dict[str, Any], *options: str) -> tuple[int, str, dict[str, Any]]:
    """Exit code, what is printed and the record of a problem solved by the command line."""
    file = path / "problem.toml"
    file.write_text(tomlkit.dumps(data))
    result = CliRunner().invoke(app, ["solve", str(file), "--out", str(path), *options])
    record = json.loads((path / data["name"] / "solution.json").read_text())
    return result.exit_code, result.output, record


@pytest.mark.drawn(2)
@pytest.mark.parametrize(
    ("family", "seed"),
    [("too short", 0), ("too thick", 2), ("too stiff", 0), ("blocked", 0), ("contact", 1), ("torque", 0)],
)
def test_the_reason_is_true_and_what_helps_is_told(tmp_path: Path, family: str, seed: int) -> None:
    """A problem of each family: exit code 3, the true reason by name, a verified change close to the threshold."""
    case = make_case(family, seed)
    code, output, record = ends_with(tmp_path, {**case.data, "planner": {"time_limit": 60.0}})
    assert (code, record["status"]) == (3, "infeasible")
    diagnosis = record["diagnosis"]
    assert named_rightly(case, diagnosis), diagnosis
    assert relaxation_error(case, diagnosis) <= (0.3 if family == "too thick" else 0.05), diagnosis
    assert all(sentence in output for sentence in sentences(diagnosis["reason"]))
    assert all(f"solved with {relaxed['words']}" in output for relaxed in diagnosis["relaxations"])
    assert all(0.0 <= first["change"] <= 1.0 for first in diagnosis["relaxations"])
    assert "motion" not in record["timings"]


def test_without_diagnosis_the_reason_stands_alone(tmp_path: Path) -> None:
    """``--no-diagnosis`` tries nothing: the reason is there, no relaxation, no stage of that name."""
    code, output, record = ends_with(tmp_path, make_case("torque", 0).data, "--no-diagnosis")
    assert code == 3
    assert "needs" in output
    assert record["diagnosis"]["relaxations"] == []
    assert "diagnosis" not in record["timings"]


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (
            [0.9, 0.1],
            "goal.position: out of reach: the arm is 0.505 m too short\n    the goal is 0.906 m from",
        ),
        ([0.0, 0.3], "goal.position: the goal is in contact: the tip is 100.0 mm inside 'post' at"),
        ([0.0, 0.19], "goal.position: the goal is in contact: the tip overlaps 'post' by 10.0 mm"),
        ([0.39, 0.0, 180.0], "cannot turn enough"),
    ],
)
def test_goals_that_cannot_be_reached_are_no_input_errors(
    tmp_path: Path, small_text: str, place: list[float], words: str
) -> None:
    """Out of reach, in an obstacle, too near to one, or against all bends: exit code 3, key path, figures, a record."""
    text = small_text.replace("position = [0.3, 0.1]", f"position = {place[:2]}")
    text += f"heading_deg = {place[2]}\n" if len(place) > 2 else ""
    text = text.replace("joint_limit_deg = 60.0", "joint_limit_deg = 20.0\nbase_limit_deg = 20.0")
    data = tomlkit.parse(text).unwrap()
    code, output, record = ends_with(
        tmp_path, data, "--no-diagnosis" if place[1] < 0.1 or place[1] == 0.19 else "--no-pictures"
    )
    assert code == 3
    assert words in output
    assert record["diagnosis"]["findings"] or len(place) > 2


@pytest.mark.parametrize("seed", range(40, 52))
def test_nothing_is_proved_of_problems_whose_ends_are_free(seed: int) -> None:
    """A goal that is the tip of a free pose of the arm, among polygons, fails no necessary check."""
    scene = clutter(seed, 15)
    found = failed(scene.problem())
    closed = [finding for finding in found if finding.kind not in {"too thick", "blocked"}]
    assert closed == []


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.05, 0.5), st.floats(0.0, 3.2))
def test_reach_and_bends_prove_nothing_false(seed: int, limit: float, base: float) -> None:
    """The tip of any pose within the joint limits fails neither the check of reach nor that of bends."""
    rng = np.random.default_rng(seed)
    arm = make_arm(12, joint_limit=limit, base_limit=base)
    bends = rng.uniform(-1.0, 1.0) * limit + rng.uniform(-1.0, 1.0, 12) * limit
    bends = np.clip(np.where(rng.random(12) < 0.3, limit, bends), -limit, limit)
    bends[0] = rng.uniform(-base, base)
    headings = arm.headings(bends)
    goal = TipGoal(arm.joint_positions(headings)[-1], heading=float(headings[-1]))
    refuse_impossible(Scene(arm, Workspace(shapely.box(-3, -3, 3, 3)), np.zeros(12), headings).problem(goal))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.integers(2, 16), st.floats(0.01, 1.0))
def test_no_chain_has_a_shorter_chord_than_the_regular_arc(seed: int, links: int, bend: float) -> None:
    """Cauchy's arm lemma: links whose bends stay below a bound end no nearer to their start than the regular arc."""
    rng = np.random.default_rng(seed)
    bends = bend * np.clip(rng.normal(0.7, 0.6, links - 1), -1.0, 1.0)
    headings = np.append(0.0, np.cumsum(bends))
    chord = np.hypot(np.cos(headings).sum(), np.sin(headings).sum())
    assert chord >= least_chord(links, 1.0, bend) - 1e-9
    regular = bend * np.arange(links)
    if links * bend < 2.0 * np.pi:
        arc = np.hypot(np.cos(regular).sum(), np.sin(regular).sum())
        assert least_chord(links, 1.0, bend) == pytest.approx(arc, abs=1e-9)


def screened(radius: float = 0.02, gap: float | None = None) -> Problem:
    """A goal behind a screen that has its end at half a metre, or behind two walls with a gap between them."""
    scene = open_scene(3)
    arm = make_arm(24, radius)
    if gap is None:
        obstacles = (Obstacle("screen", PlaneShape(shapely.LineString([(0.4, -1.3), (0.4, 0.3)]), 0.02)),)
    else:
        obstacles = (
            Obstacle("upper", PlaneShape(shapely.box(0.4, 0.5 * gap, 0.45, 1.3))),
            Obstacle("lower", PlaneShape(shapely.box(0.4, -1.3, 0.45, -0.5 * gap))),
        )
    start = np.full(24, 2.0)
    return Scene(arm, Workspace(scene.workspace.boundary, obstacles), start, start).problem(
        TipGoal(np.array([0.7, 0.0])), time_limit=10.0
    )


@pytest.mark.parametrize("radius", [0.01, 0.03])
def test_the_shortest_way_is_a_taut_string(radius: float) -> None:
    """Round one end of a wall the way is as long as two tangents and an arc, to a few thousandths, never longer."""
    (way,) = planar_axis_paths(screened(radius), Deadline.never())
    exact = string_round(np.zeros(2), np.array([0.7, 0.0]), np.array([0.4, 0.3]), radius + 0.02)
    assert exact * 0.995 - 1e-3 <= way.space.shortest <= exact


def test_the_widest_way_is_half_the_gap() -> None:
    """Bisection finds the margin at which the gap closes, and both of its walls."""
    problem = screened(0.05, gap=0.07)
    (way,) = planar_axis_paths(problem, Deadline.never())
    assert way.widest(way.required_distance).unbounded_excess == pytest.approx(0.035, rel=5e-3)
    (finding,) = failed(problem)
    assert (finding.kind, set(finding.obstacles)) == ("too thick", {"upper", "lower"})
    assert finding.place == pytest.approx((0.425, 0.0), abs=0.03)
    assert finding.measured == pytest.approx(0.07, rel=5e-3)


def test_contacts_are_told_with_link_depth_and_place() -> None:
    """A post 5 mm into the ninth link of a straight start, and a self-contact of a folded one."""
    arm = make_arm(24, 0.02)
    post = Obstacle("post", PlaneShape(shapely.Point(8.5 / 24, 0.025), 0.01))
    problem = Scene(arm, Workspace(shapely.box(-2, -2, 2, 2), (post,)), np.zeros(24), np.zeros(24)).problem(
        TipGoal(np.array([0.0, 0.8]))
    )
    (finding,) = failed(problem)
    assert "link 9 overlaps 'post' by 5.0 mm" in finding.reason
    assert finding.bounds["arm.radius"] == pytest.approx(0.015)
    back = np.append(np.zeros(12), np.full(12, np.pi - 0.02))
    finding = failed(
        replace(problem, workspace=Workspace(shapely.box(-2, -2, 2, 2)), start=JointPose(arm.bends(back)))
    )[0]
    assert finding.kind == "contact"
    assert "links" in finding.reason


@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_the_load_of_a_straight_arm_is_weight_times_lever(tilt: float) -> None:
    """A straight arm at an angle needs m g L / 2 cos of it at its base; a limit just above passes, just below fails."""
    arm = make_arm(12)
    need = float(arm.masses.sum()) * GRAVITY * 0.5 * np.cos(tilt)
    scene = Scene(arm, Workspace(shapely.box(-2, -2, 2, 2)), np.full(12, tilt), np.full(12, tilt))
    problem = scene.problem(TipGoal(np.array([0.2, 0.7])))
    for share, count in ((1.001, 0), (0.999, 1)):
        limits = Limits(problem.limits.velocity, problem.limits.acceleration, np.full(36, share * need))
        found = failed(replace(problem, limits=limits))
        assert [finding.kind for finding in found] == ["torque"] * count
    assert found[0].measured == pytest.approx(need, rel=1e-6)


def test_checks_leave_out_what_does_not_apply_to_a_feed_axis() -> None:
    """An arm on a feed axis is checked for reach from every place of its base, and nothing crashes."""
    arm = make_arm(12)
    problem = Scene(arm, Workspace(shapely.box(-3, -3, 3, 3)), np.zeros(12), np.zeros(12)).problem()
    limits = Limits(problem.limits.velocity, problem.limits.acceleration, feed_velocity=0.1, feed_acceleration=0.5)
    fed, goal = replace(arm, feed=Feed(0.0, 0.5, 0.5)), TipGoal(np.array([1.4, 0.0]))
    problem = replace(problem, arm=fed, limits=limits, goal=goal)
    assert failed(problem) == ()
    assert suspected_causes(problem, later(900.0)) == ()
    far = failed(replace(problem, goal=TipGoal(np.array([1.6, 0.0]))))
    assert [finding.kind for finding in far] == ["too short"]


class Threshold:
    """Solves a problem when a parameter has passed a value, and remembers what it was asked."""

    def __init__(self, parameter: Parameter, value: float) -> None:
        self.parameter, self.value = parameter, value
        self.asked: list[float] = []

    def __call__(self, problem: Problem) -> None:
        """Raise as a planner does."""
        got = self.parameter.read(problem)
        self.asked.append(got)
        if self.parameter.easier * (got - self.value) < 0.0:
            raise MotionNotFound(Diagnosis("no", "motion"))


@settings(max_examples=50, deadline=None)
@given(st.sampled_from([RADIUS, LENGTH, JOINT_LIMIT]), st.floats(0.0, 0.6), st.booleans())
def test_a_relaxation_was_solved_and_is_close_to_the_threshold(
    parameter: Parameter,
    beyond: float,
    known: bool,
) -> None:
    """The value told is one that was solved, beyond the threshold, and within a tenth of it when a bound is known."""
    problem = open_scene(1).problem()
    given_value = parameter.read(problem)
    bound = given_value * (1.0 + parameter.easier * 0.2)
    threshold = bound * (1.0 + parameter.easier * (0.02 if known else 0.4 * beyond))
    solver = Threshold(parameter, threshold)
    found = least_change(parameter, problem, bound if known else None, Trials(solver, later(900.0)))
    if found is None:
        assert not known
        return
    assert found.value in solver.asked
    assert isinstance(found.value, float)
    assert parameter.easier * (found.value - threshold) >= 0.0
    assert abs(found.value - threshold) <= 0.1 * threshold
    assert f"{parameter.key.split('.')[-1]}" in found.words


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([RADIUS, JOINT_LIMIT]), st.floats(0.0, 0.25))
def test_a_plan_that_holds_nearer_to_the_threshold_spares_the_search(parameter: Parameter, holds: float) -> None:
    """What was found at one value is held against nearer ones, none of which is searched again where it holds."""
    problem = open_scene(1).problem()
    begin = parameter.read(problem)
    sought = Threshold(parameter, begin * (1.0 + parameter.easier * 0.3))
    held = Threshold(parameter, begin * (1.0 + parameter.easier * holds))
    trials = Trials(sought, later(900.0), hold_again=lambda changed, _: held(changed))
    found = least_change(parameter, problem, begin, trials)
    assert found is not None
    assert isinstance(found.value, float)
    assert parameter.easier * (found.value - held.value) >= 0.0
    # Steps of 4.5, 10 and 20 % fail, 40 % works: those that failed and what is nearer than was held is not sought.
    if holds <= 0.2:
        assert len(sought.asked) == 4
        assert abs(found.value - held.value) <= 0.1 * begin


@given(st.sampled_from(PARAMETERS), st.floats(1e-3, 3.0))
def test_values_are_rounded_to_the_easier_side(parameter: Parameter, value: float) -> None:
    """What is told is never harder than what was found, and off by less than a thousandth."""
    problem = make_limited(open_scene(1).problem())
    rounded = parameter.rounded(problem, value)
    assert parameter.easier * (rounded - value) >= -1e-6 * value
    assert abs(rounded - value) <= 1.1e-3 * value


def make_limited(problem: Problem) -> Problem:
    """The same with a torque limit of 3 N m."""
    limits = problem.limits
    return replace(problem, limits=Limits(limits.velocity, limits.acceleration, np.full(3 * problem.arm.links, 3.0)))


def test_no_time_no_trial() -> None:
    """Nothing is tried when no time is left; the findings are told all the same."""
    problem = screened(0.05, gap=0.07)
    solver = Threshold(RADIUS, 1.0)
    error = explain_failure(problem, UnreachableGoal(Diagnosis("no way", "free space")), Trials(solver, later(0.0)))
    assert solver.asked == []
    assert error.diagnosis.findings[0].kind == "too thick"
    assert error.diagnosis.relaxations == ()
    assert "too thick" in str(error)
    assert any("arm.radius" in line for line in error.diagnosis.advice)


@pytest.mark.parametrize(
    ("ended", "code", "status"),
    [(KeyboardInterrupt, 130, "cancelled"), (MemoryError, 3, "infeasible"), (ValueError, 1, "infeasible")],
)
@pytest.mark.parametrize("case", [make_case("contact", 1), make_space_case("contact", 1)])
def test_the_reason_stands_whatever_ends_the_search_for_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: Case, ended: type[BaseException], code: int, status: str
) -> None:
    """It is printed once, before any change is tried, and recorded; memory has run out only where it did."""

    def relaxed(*_: object) -> Iterator[Relaxation]:
        raise ended

    monkeypatch.setattr(explain, "relaxations", relaxed)
    ended_with, output, record = ends_with(tmp_path, case.data)
    assert (ended_with, record["status"]) == (code, status)
    assert record["diagnosis"]["findings"][0]["kind"] == "contact"
    reason, *_ = sentences(record["diagnosis"]["reason"])
    assert output.count(f"problem.toml: {reason}") == 1
    assert ("memory" in output) == (ended is MemoryError)
    assert "more exactly" not in output


def test_the_time_limit_keeps_the_reason(tmp_path: Path) -> None:
    """Where no time is left for changes the reason is there all the same."""
    code, output, record = ends_with(tmp_path, make_case("contact", 1).data, "--time-limit", "0.001", "--no-pictures")
    assert (code, record["status"]) == (3, "infeasible")
    assert "in contact" in output
    assert record["diagnosis"]["relaxations"] == []


def test_changes_are_told_of_before_they_are_tried_and_once_they_help() -> None:
    """Who listens hears the reason first, then every change with the time that is spent of what may be."""
    heard: list[object] = []
    solver = Threshold(RADIUS, 0.03)

    def solve(problem: Problem) -> object:
        heard.append("tried")
        return solver(problem)

    error = UnreachableGoal(Diagnosis("no way", "free space"))
    stages = Stages(heard.append)
    with stages("diagnosis"):
        told = explain_failure(screened(0.05, gap=0.07), error, Trials(solve, later(900.0)), stages)
    news = [each for each in heard if isinstance(each, Progress)]
    known = [each.known for each in news if each.known is not None]
    assert "too thick" in known[0].reason
    assert known[0].relaxations == ()
    assert known[-1].relaxations == told.diagnosis.relaxations != ()
    first = heard.index("tried")
    assert any(isinstance(each, Progress) and each.known is known[0] for each in heard[:first])
    before = [heard[k - 1] for k, each in enumerate(heard) if each == "tried"]
    assert all(isinstance(each, Progress) and each.name and each.limit == 15.0 for each in before)


def test_figures_of_reasons_explain_those_of_changes() -> None:
    """What helps far beyond its bound says what the reason asks for; what lacks is distance less tolerance."""
    problem = screened(0.05, gap=0.07)
    assert RADIUS.relaxation(problem, 0.0254, 0.0327).words.endswith("; the reason alone requires at most 0.0327 m")
    assert RADIUS.relaxation(problem, 0.0254, 0.026).words == "arm.radius = 0.0254 m"
    far = replace(problem, goal=TipGoal(np.array([2.0, 0.0])), tolerances=Tolerances(0.002))
    (finding,) = failed(far, (within_reach,))
    short = 2.0 - 0.002 - problem.arm.length
    assert f"out of reach: the arm is {short:.3f} m too short; the goal is 2.000 m from the base" in finding.reason
    assert "less 0.002 m of tolerance" in finding.reason


def test_a_search_that_failed_is_explained_by_what_is_tight_and_what_helps() -> None:
    """Nothing is proved: the tightest places are told as likely, first the kind that the smallest change mends."""
    problem = screened(0.03, gap=0.066)
    error = MotionNotFound(Diagnosis("no motion found in 7 candidates", "motion", ("raise planner.routes",)))
    solver = Threshold(RADIUS, 0.028)
    told = explain_failure(problem, error, Trials(solver, later(900.0)))
    assert isinstance(told, MotionNotFound)
    assert told.diagnosis.reason == "no motion found in 7 candidates"
    first = told.diagnosis.findings[0]
    assert (first.kind, first.proved, set(first.obstacles)) == ("too thick", False, {"upper", "lower"})
    assert told.diagnosis.relaxations[0].key == "arm.radius"
    assert "perhaps: the arm has little clearance: no way" in str(told)


def test_what_was_tried_and_did_not_help_is_no_advice() -> None:
    """A change without a plan is reported with its time and not advised; what a bound says of passages stays."""

    def hopeless(_: Problem, __: str = "") -> object:
        raise MotionNotFound(Diagnosis("no", "motion"))

    problem = screened(0.03, gap=0.066)
    advice = ("reduce arm.radius (not tried)", "raise planner.routes (not tried)")
    told = explain_failure(
        problem, MotionNotFound(Diagnosis("no motion", "motion", advice)), Trials(hopeless, later(900.0))
    )
    assert "not solved with arm.radius = " in str(told)
    assert ", within 2.5 s" in told.diagnosis.failed_changes[0]
    assert told.diagnosis.advice == ("raise planner.routes (not tried)",)
    assert "too thick" in [finding.kind for finding in told.diagnosis.findings]


def test_a_joint_that_timing_finds_too_weak_is_the_reason() -> None:
    """The torque on the path is told with its limit; torque and mass are relaxed from that bound."""
    problem = make_limited(open_scene(1).problem())
    evidence = {"revolute": 1, "torque": 4.5, "limit": 3.0, "path_position": 0.5}
    error = RetimingError(Diagnosis("joint 1 needs 4.5 N m", "retiming", (), evidence))
    told = explain_failure(problem, error, Trials(lambda _: None, later(900.0))).diagnosis
    assert [finding.reason for finding in told.findings] == [told.reason] == ["joint 1 needs 4.5 N m"]
    words = {relaxed.key: relaxed for relaxed in told.relaxations}
    assert words["limits.torque"].words == "limits.torque = 4.703 N m"
    assert words["limits.torque"].value == pytest.approx(4.703)
    assert words["arm.link_mass"].bound == pytest.approx(problem.arm.masses[0] / 1.5)


def test_relaxations_change_one_thing_only() -> None:
    """Every parameter written back reads the same, and leaves the others as they are."""
    problem = make_limited(screened())
    for parameter in PARAMETERS:
        if parameter in (TORQUE, MASS) or not parameter.fits(problem):
            continue
        changed = parameter.write(problem, 1.1 * parameter.read(problem))
        assert parameter.read(changed) == pytest.approx(1.1 * parameter.read(problem))
        others = [other for other in PARAMETERS if other is not parameter]
        assert all(other.read(changed) == other.read(problem) for other in others)
    heavier = MASS.write(problem, 2.0)
    np.testing.assert_allclose(heavier.arm.masses, 2.0 * problem.arm.masses)
    np.testing.assert_allclose(heavier.arm.inertia_axial, 2.0 * problem.arm.inertia_axial)


def test_a_sound_obstacle_is_not_removed_where_that_does_not_help() -> None:
    """Only what mends all that is proved is tried: with a weak joint too, no obstacle is."""
    findings = (
        Finding("blocked", "closed", obstacles=("screen",)),
        Finding("torque", "weak", bounds={"limits.torque": 2.0, "arm.link_mass": 0.5}),
    )
    tried: list[Problem] = []
    assert tuple(relaxations(make_limited(screened()), findings, Trials(tried.append, later(900.0)))) == ()
    assert tried == []


def test_what_is_proved_comes_first() -> None:
    """Proved findings stand before likely ones, elementary before derived ones, and none twice."""
    likely = Finding("too short", "perhaps short", proved=False)
    weak, touching = Finding("torque", "weak"), Finding("contact", "touches")
    assert rank_findings((likely, weak, touching, weak)) == (touching, weak, likely)


def test_a_path_is_recalled_when_only_loads_change() -> None:
    """Limits and masses leave the path; another radius asks the planner again."""
    path: JointPath = object()  # type: ignore[assignment] - nobody looks at it
    problem = make_limited(screened())
    known = [(problem, path)]
    for changed in (problem, TORQUE.write(problem, 2.0), MASS.write(problem, 0.5)):
        assert recorded_path(known, changed) is path
    assert recorded_path(known, RADIUS.write(problem, 0.01)) is None


def test_defects_of_the_input_are_not_explained() -> None:
    """Only a missing plan is explained; an unusable problem passes through, an unusable try counts as failed."""
    problem = screened()

    class Refusing:
        """Finds the problem unusable."""

        def plan(self, problem: Problem) -> JointPath:
            """Refuse it."""
            raise ProblemError(f"unusable: {problem.name}")

    with pytest.raises(ProblemError, match="unusable"):
        ccm_opt.solve(problem, planner=Refusing())

    def unusable(changed: Problem) -> object:
        del changed
        raise ProblemError("unusable")

    assert not Trials(unusable, later(900.0)).succeeds(problem, "another goal")


@pytest.mark.planning
@pytest.mark.parametrize("family", FAMILIES)
def test_problems_of_the_families_are_impossible_and_possible_beyond_their_threshold(family: str) -> None:
    """The closed form of every family agrees with the checks: they fail as given, and hold beyond the threshold."""
    for seed in range(20, 26):
        case = make_case(family, seed)
        problem = problem_from_mapping(case.data)
        assert family in {finding.kind for finding in failed(problem)}, case
        if isinstance(case.threshold, str):
            kept = [o for o in case.data["workspace"]["obstacles"] if o["name"] != case.threshold]
            easier = problem_from_mapping({**case.data, "workspace": {**case.data["workspace"], "obstacles": kept}})
        else:
            parameter = next(each for each in PARAMETERS if each.key == case.key)
            scale = case.data["limits"]["torque"] if parameter is TORQUE else 1.0
            easier = parameter.write(problem, case.threshold / scale * (1.0 + 0.1 * case.sign))
        assert failed(easier) == (), (case, failed(easier))


def test_random_poses_are_drawn_within_the_limits() -> None:
    """The scenes that the laws above rest on bend no joint too far."""
    arm = make_arm(24)
    headings = random_headings(np.random.default_rng(0), arm)
    assert np.all(np.abs(arm.bends(headings)) <= arm.bend_limits)
