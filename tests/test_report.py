"""The page of a plan or a failure: complete, true to the arrays behind it, and safe from what names contain."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ccm_opt.cli.outcome import NO_PLAN
from ccm_opt.cli.solving import solve_files
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Diagnosis, Finding, Relaxation
from ccm_opt.driver.clearance_over_time import clearance_over_time
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Problem, Stop
from ccm_opt.problem.solution import Check, GoalPoseRecord, Solution, ToleratedError
from ccm_opt.scene.workspace import Obstacle, PlaneShape
from ccm_opt.viz.checks_section import checks_in_words
from ccm_opt.viz.document import MINUS, PageUnits, coded, three_digits
from ccm_opt.viz.failure_page import failure_data, failure_html
from ccm_opt.viz.page import report_html
from ccm_opt.viz.time_series import limit_shares, select_samples, series_groups

NASTY = "</script><script>alert(1)</script><b title='\"x'>&amp;"
MILLIMETRES = PageUnits.of_arm(0.6)


def page_data(page: str) -> SimpleNamespace:
    """What the page's scripts are given."""
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    return SimpleNamespace(**json.loads(found[1]))


def decoded(array: dict[str, object]) -> FloatArray:
    """The inverse of the coding of arrays, as the page's script does it."""
    return np.cumsum(array["d"]) * float(array["step"])  # type: ignore[arg-type]


class Elements(HTMLParser):
    """Every element of a page with its attributes, and the text of all but scripts."""

    def __init__(self, page: str) -> None:
        """Read a page."""
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.inside = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note an element."""
        self.inside = tag
        self.found.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        """What follows is in no script."""
        del tag
        self.inside = ""

    def handle_data(self, data: str) -> None:
        """Note a text."""
        if self.inside not in {"script", "style"}:
            self.texts.append(data)

    @property
    def text(self) -> str:
        """All texts, with single blanks."""
        return " ".join(" ".join(self.texts).split())


def beside_a_post(solution: Solution) -> Solution:
    """The same plan with a post 10 mm beside the last place of the tip, in an otherwise empty room."""
    arm = solution.problem.arm
    tip = solution.joint_positions[-1, -1] + np.array([0.0, arm.radius + 0.04])
    workspace = replace(solution.problem.workspace, obstacles=(Obstacle("post", PlaneShape(shapely.Point(tip), 0.03)),))
    return replace(solution, problem=replace(solution.problem, workspace=workspace))


def test_the_curves_pass_all_samples(small_solution: Solution) -> None:
    """Every curve of every chart comes within its error of every sample, and has its least and greatest value."""
    time = small_solution.trajectory.time
    groups = {group["key"]: group for group in page_data(report_html(small_solution)).groups}
    for whole in series_groups(small_solution):
        group = groups[whole.key]
        shown = decoded(group["time"])
        extent = max(float(np.ptp(whole.values)), 1e-12)
        for column, values, limit in zip(group["columns"], whole.values.T, whole.limits, strict=True):
            curve = decoded(column)
            np.testing.assert_allclose(np.interp(time, shown, curve), values, atol=4e-3 * extent)
            assert curve.max() == pytest.approx(values.max(), abs=float(column["step"]))
            assert curve.min() == pytest.approx(values.min(), abs=float(column["step"]))
            assert group["limits"][whole.names.index(group["names"][0])] == (
                pytest.approx(whole.limits[0]) if np.isfinite(limit) else None
            )
    assert {"bends", "velocities", "accelerations", "torques", "tip-speed", "tracking"} <= set(groups)


def test_the_arm_of_the_page_is_that_of_the_plan(small_solution: Solution) -> None:
    """From the page's bends the tip comes out where the plan has it, at every sample to a thousandth of the arm."""
    data = page_data(report_html(small_solution))
    arm = small_solution.problem.arm
    group = next(group for group in data.groups if group["key"] == "bends")
    shown = decoded(group["time"])
    time = small_solution.trajectory.time
    bends = np.deg2rad([np.interp(time, shown, decoded(column)) for column in group["columns"]]).T
    tips = arm.joint_positions(arm.headings(bends))[:, -1]
    np.testing.assert_allclose(tips, small_solution.joint_positions[:, -1], atol=1e-3 * arm.length)
    drawn = data.scene["arm"]
    assert (drawn["links"], drawn["link"], drawn["radius"]) == (arm.links, arm.link_length, arm.radius)
    assert data.scene["goals"][0]["place"] == pytest.approx([0.3, 0.1])


def test_the_page_shows_the_room_over_time(small_solution: Solution) -> None:
    """Gaps, wanted gap, clearance and least gap of the chart are those of the record; lacks stand in words."""
    plan = beside_a_post(small_solution)
    room = clearance_over_time(plan.problem, plan.trajectory, 0.03)
    page = report_html(replace(plan, room=room))
    gaps = page_data(page).gaps
    np.testing.assert_allclose(decoded(gaps["time"]), room.time, atol=1e-5)
    np.testing.assert_allclose(decoded(gaps["walls"]), room.wall_gaps, atol=2e-4 * room.gaps.max())
    np.testing.assert_allclose(decoded(gaps["itself"]), room.self_gaps, atol=2e-4 * room.gaps.max())
    assert (gaps["wanted"], gaps["clearance"]) == (room.wanted, room.clearance)
    assert gaps["nearest"]["gap"] == room.nearest.gap
    assert gaps["nearest"]["pair"] == room.nearest.pair
    place = np.array(page_data(page).nearest["place"])
    post = plan.problem.workspace.obstacles[0]
    half = 0.5 * (room.nearest.gap + plan.problem.arm.radius)
    # The mark stands half-way between the two cores: nearer to neither than half of what lies between the surfaces.
    assert shapely.distance(post.core, shapely.Point(place)) >= half
    assert Elements(page).text.count("of the preferred 30 mm from") == len(room.short)


def test_the_phase_plane_is_that_of_the_motion(small_solution: Solution) -> None:
    """Way and speed are length and rate of the path of the bends; shares are those of the limits, with their drives."""
    phase = page_data(report_html(small_solution)).phase
    trajectory = small_solution.trajectory
    shown = decoded(phase["time"])
    bends = np.array([np.interp(shown, trajectory.time, column) for column in trajectory.bend_angles.T]).T
    way = np.cumsum(np.linalg.norm(np.diff(np.rad2deg(bends), axis=0, prepend=np.rad2deg(bends[:1])), axis=1))
    np.testing.assert_allclose(decoded(phase["place"]), way, rtol=1e-3, atol=1e-3 * way[-1])
    speeds = np.linalg.norm(trajectory.bend_velocities, axis=1)
    np.testing.assert_allclose(decoded(phase["speed"]), np.interp(shown, trajectory.time, speeds), atol=1e-3)
    limits = small_solution.problem.limits
    velocity = np.max(np.abs(small_solution.joints.velocities) / limits.velocity, axis=1)
    assert max(decoded(phase["shares"][phase["kinds"].index("velocity")])) == pytest.approx(velocity.max(), abs=1e-3)
    for share in limit_shares(small_solution):
        assert np.all(share.share >= 0.0)
        assert max(share.drive) < len(share.drives)


def test_every_check_has_its_row_in_words(small_solution: Solution) -> None:
    """What a user asked for stands in the table, the plan's checks of itself behind a fold, in units for people."""
    checks = (
        Check("samples", 0.004, 0.005, "s", "251 samples", passed=True),
        Check("goal position", 2e-11, 1e-3, "m", "tip at t = 1.0000 s", passed=True),
        Check("wall clearance", 0.00708, 0.0, "m", "link 3 to 'post' at t = 0.2500 s", passed=True),
        Check("joint limit", 0.602, 1.0, "rad", "joint 2 at t = 0.5000 s", passed=False),
        Check("constraint <level>", -0.2, 1e-6, "", "at t = 0.1 s", passed=True),
    )
    page = Elements(report_html(replace(small_solution, checks=checks)))
    rows = checks_in_words(checks, MILLIMETRES)
    assert [row.title for row in rows][-1] == "Longest step between samples"
    assert rows[0].title == "Joint bends"  # what fails comes first
    assert "34.5°" in page.text
    assert "7.08 mm" in page.text
    assert "0.00 mm" in page.text
    assert "2e-11" not in page.text
    assert "Your constraint “<level>”" in page.text
    folded = page.text.index("1 checks of the plan's consistency, all passed")
    assert folded > page.text.index("Gap to walls")
    times = [attributes["data-time"] for tag, attributes in page.found if tag == "button" and "data-time" in attributes]
    assert times == ["0.5000", "0.2500", "1.0000", "0.1000"]


@pytest.mark.parametrize(
    ("value", "finest", "text"),
    [
        (7.0831, 2, "7.08"),
        (34.49, 2, "34.5"),
        (432.4, 2, "432"),
        (2e-9, 2, "0.00"),
        (-2e-9, 2, "0.00"),
        (-1.5, 2, f"{MINUS}1.50"),
    ],
)
def test_numbers_are_as_people_read_them(value: float, finest: int, text: str) -> None:
    """Three digits, never an exponent, and nothing where there is nothing."""
    assert three_digits(value, finest) == text


def test_units_follow_the_size_of_the_arm() -> None:
    """Small arms are spoken of in micrometres, large ones in metres; what somebody chose has no zeros at its end."""
    assert PageUnits.of_arm(0.001).length(5e-6) == "5.00 µm"
    assert PageUnits.of_arm(40.0).length(1.5) == "1.50 m"
    assert MILLIMETRES.given(0.009, "m") == "9 mm"
    assert PageUnits.of_file("m", 0.55).given(5.5e-10, "m") == "5.5e-10 m"
    assert MILLIMETRES.given(np.pi / 3.0, "rad") == "60°"
    assert MILLIMETRES.shown(2.5e-6, "N m", 4e-6) == "2.50 µN m"


@given(arrays(np.float64, (60, 3), elements=st.floats(-1.0, 1.0)), st.floats(0.01, 0.5))
def test_thinned_curves_pass_within_the_tolerance(columns: FloatArray, tolerance: float) -> None:
    """Lines between the samples that are kept pass all others within the tolerance; extremes are kept."""
    time = np.linspace(0.0, 2.0, 60)
    kept = select_samples(time, columns, tolerance, 60, np.array([7], dtype=np.intp))
    assert 7 in kept
    for column in columns.T:
        assert np.max(np.abs(np.interp(time, time[kept], column[kept]) - column)) <= tolerance + 1e-12
        assert column[kept].max() == column.max()
        assert column[kept].min() == column.min()


@given(arrays(np.float64, 20, elements=st.floats(-1e3, 1e3)), st.sampled_from([1e-3, 0.1, 2.0]))
def test_coded_arrays_are_exact_to_half_a_step(values: FloatArray, step: float) -> None:
    """Errors of the coding do not add up along the array."""
    np.testing.assert_allclose(decoded(coded(values, step)), values, atol=0.5 * step * (1.0 + 1e-9))


def test_the_page_loads_nothing(small_solution: Solution) -> None:
    """Nothing comes from elsewhere, links lead to files of the folder, and only the page's own script may run."""
    page = report_html(small_solution)
    elements = Elements(page)
    assert not [attributes for _, attributes in elements.found if "src" in attributes]
    links = {attributes["href"] for _, attributes in elements.found if "href" in attributes}
    assert "solution.json" in links
    assert all(link is not None and re.fullmatch(r"[a-z.]+", link) for link in links)
    policy = next(attributes for tag, attributes in elements.found if attributes.get("http-equiv"))
    assert "default-src 'none'" in str(policy["content"])
    assert "{{" not in page
    assert len(page.encode()) < 2_000_000


def test_names_cannot_break_the_page(small_solution: Solution) -> None:
    """Markup in any name stands there as text, on the page of a plan and on that of a failure."""
    clean = [tag for tag, _ in Elements(report_html(small_solution)).found]
    workspace = small_solution.problem.workspace
    renamed = replace(workspace, obstacles=(replace(workspace.obstacles[0], name=NASTY),))
    problem = replace(small_solution.problem, name="n<i>", description=NASTY, workspace=renamed)
    checks = tuple(replace(check, where=check.where + NASTY) for check in small_solution.checks)
    page = report_html(replace(small_solution, problem=problem, checks=checks, versions={NASTY: NASTY}))
    assert [tag for tag, _ in Elements(page).found] == clean
    assert page_data(page).scene["obstacles"][0]["name"] == NASTY

    finding = Finding("contact", NASTY, place=(0.1, 0.1), obstacles=(NASTY,))
    diagnosis = Diagnosis(NASTY, NASTY, (NASTY,), {"x": NASTY}, (finding,), (Relaxation(NASTY, "k", 1.0, None),))
    failed = Elements(failure_html(problem, "infeasible", diagnosis, {NASTY: 1.0}))
    assert "b" not in [tag for tag, _ in failed.found]
    assert [tag for tag, _ in failed.found].count("script") == 2


def a_goal_pose(solution: Solution, *, reached: bool) -> GoalPoseRecord:
    """A record whose pose is the last of a solution."""
    return GoalPoseRecord(
        reached=reached,
        reason="" if reached else "the way to it is <closed>",
        configuration=solution.trajectory.bend_angles[-1],
        curve=solution.path.curves[-1],
        gap=0.004,
        wanted_gap=0.009,
        costs={"room": 2.0, "bending": 1.5, "user: look <ahead>": 0.25},
        multipliers={
            "link 4: side 2 of its region, at its end": 8.0,
            "link 4: side 1 of its region, at its end": 4.0,
            "joint 2: bend left": 0.5,
            "joint 1: torque up": 0.2,
            "user: level": 0.1,
        },
        iterations=17,
        size=(90, 200),
        status="Solve_Succeeded",
        tried=3,
    )


@pytest.mark.parametrize("reached", [True, False])
def test_the_page_says_why_the_arm_ends_where_it_does(small_solution: Solution, reached: bool) -> None:
    """Every segment, every part of the cost and every binding row has its line, in words, with its own unit."""
    record = a_goal_pose(small_solution, reached=reached)
    plan = beside_a_post(small_solution)
    page = report_html(replace(plan, path=replace(plan.path, goal_pose=record)))
    section = page[page.index("why the arm ends here") : page.index("The problem</h2>")]
    rows = re.findall(r'<tr><td>(.*?)</td><td class="n">(.*?)</td><td.*?>(.*?)</td></tr>', section)
    # Two rows of one link beside one wall are one line: 12 for an arm's length of 0.4 m are 0.03 for 1 mm.
    assert ("link 4 next to &#x27;post&#x27;", "0.03", "per 1 mm") in rows
    assert ("joint 2 at its left limit", "0.0087", "per 1°") in rows
    assert ("torque limit of joint 1", "0.002", "per 1 % more") in rows
    assert ("your constraint &#x27;level&#x27;", "0.1", "per 1 of its unit") in rows
    assert len(rows) == 4 + len(record.costs) + len(record.curve.segments)
    assert "your cost &#x27;look &lt;ahead&gt;&#x27;" in section
    assert ("The motion ends in this pose" in section) == reached
    assert ("the way to it is &lt;closed&gt;" in section) != reached


def test_the_page_says_what_a_plan_survives(small_solution: Solution) -> None:
    """Errors that a plan survives stand in a section in degrees and millimetres; without any it is gone."""
    joints = ToleratedError("joints", 0.01, "rad", "link 2 to 'wall' at t = 0.5000 s", 0.5, 2)
    walls = ToleratedError("walls", 0.02, "m", "nothing; larger errors are not examined", limited=False)
    page = Elements(report_html(replace(small_solution, tolerance=(joints, walls))))
    assert "Every joint off by 0.57°: limited by link 2 to 'wall' at 0.50 s." in page.text
    assert "Every wall closer by ≥ 20.0 mm" in page.text
    assert "Tolerated errors" not in report_html(replace(small_solution, tolerance=()))


def test_a_tour_marks_its_goals_on_the_time_axis(small_solution: Solution) -> None:
    """Every stop and the goal has its number at its own time, and the sample of the stop is kept in every chart."""
    trajectory = replace(small_solution.trajectory, stops=(100,))
    asked = small_solution.problem
    problem = replace(asked, stops=(Stop(asked.goal, asked.tolerances),))
    data = page_data(report_html(replace(small_solution, problem=problem, trajectory=trajectory)))
    assert [mark["words"] for mark in data.marks] == ["1", "2"]
    assert [mark["at"] for mark in data.marks] == pytest.approx([trajectory.time[100], trajectory.time[-1]])
    for group in data.groups:
        assert np.min(np.abs(decoded(group["time"]) - trajectory.time[100])) < 2e-5


FAILURES = """\
schema = 1
name = "closed"
[workspace]
bounds = [-0.2, -0.5, 1.2, 0.6]
obstacles = [
  { name = "upper", box = [0.4, 0.14, 0.5, 0.6] },
  { name = "lower", box = [0.4, -0.5, 0.5, 0.1] },
]
[arm]
links = 12
link_length = 0.08
radius = 0.03
base = [0.0, -0.45]
base_heading_deg = 90.0
joint_limit_deg = 60.0
[limits]
velocity = 2.0
acceleration = 10.0
[start]
shape = "straight"
[goal]
position = [0.7, 0.12]
"""


def marks_of(finding: Finding) -> list[dict[str, object]]:
    """What the page draws of one finding."""
    problem = parse_problem(FAILURES)
    data = failure_data(problem, Diagnosis(finding.reason, "checks", findings=(finding,)), MILLIMETRES)
    assert data["blocking"] == list(finding.obstacles)
    marks = data["marks"]
    assert isinstance(marks, list)
    return marks


def test_a_gap_that_is_too_narrow_is_drawn() -> None:
    """The line of the gap leads from wall to wall, and the disc is as wide as the arm."""
    finding = Finding("too thick", "r", place=(0.45, 0.12), measured=0.04, allowed=0.06, obstacles=("upper", "lower"))
    disc, gap, words = marks_of(finding)
    assert disc["radius"] == pytest.approx(0.03)
    np.testing.assert_allclose(sorted(gap["points"]), [[0.45, 0.1], [0.45, 0.14]], atol=1e-9)  # type: ignore[type-var]
    assert words["words"] == "gap 40.0 mm, arm 60.0 mm"


def test_a_goal_out_of_reach_is_drawn() -> None:
    """The circle of reach has the arm's length, and the line leads from it to the goal."""
    finding = Finding("too short", "r", place=(0.0, 0.75), measured=1.2, allowed=0.96)
    circle, missing, words = marks_of(finding)
    assert circle["radius"] == pytest.approx(0.96)
    np.testing.assert_allclose(missing["points"], [[0.0, 0.51], [0.0, 0.75]], atol=1e-9)
    assert words["words"] == "arm 240 mm too short"


def test_a_way_that_is_too_long_is_drawn() -> None:
    """The way has all its corners."""
    way = ((0.0, -0.45), (0.4, -0.3), (0.7, 0.12))
    finding = Finding("too short", "r", place=(0.4, -0.3), measured=1.2, allowed=0.96, way=way)
    drawn, words = marks_of(finding)
    assert drawn["points"] == [list(place) for place in way]
    assert words["words"] == "shortest way 1200 mm, arm 960 mm"


def test_the_page_of_a_failure_says_what_would_help(small_problem: Problem) -> None:
    """Reason, further findings, changes that were solved and advice stand there in words."""
    findings = (Finding("contact", "the first reason"), Finding("torque", "another one", proved=False))
    relaxations = (Relaxation("arm.radius ≤ 9 mm", "arm.radius", 0.009, 0.01),)
    diagnosis = Diagnosis("the first reason", "necessary checks", ("do this",), {"x": 1.0}, findings, relaxations)
    page = Elements(failure_html(small_problem, "infeasible", diagnosis, {"free space": 0.25}))
    for words in (
        "proved infeasible",
        "the first reason.",
        "Perhaps: another one.",
        "arm.radius ≤ 9 mm",
        "do this",
    ):
        assert words in page.text
    assert "0.25 s" in page.text


def test_a_way_that_is_too_long_leads_from_base_to_goal(tmp_path: Path) -> None:
    """The finding of the command line has the whole way, as long as it says, and the folder of the failure its page."""
    gate = 'name = "lower", box = [0.4, -0.5, 0.5, 0.1]'
    text = FAILURES.replace(gate, 'name = "screen", box = [0.4, -0.3, 0.5, 0.2]')
    file = tmp_path / "closed.toml"
    file.write_text(text.replace("[0.7, 0.12]", "[0.68, 0.16]"), encoding="utf-8")
    assert solve_files([file], tmp_path / "runs", explain=False) == NO_PLAN
    record = json.loads((tmp_path / "runs" / "closed" / "solution.json").read_text(encoding="utf-8"))
    finding = next(each for each in record["diagnosis"]["findings"] if each["way"])
    way = np.array(finding["way"])
    np.testing.assert_allclose(way[[0, -1]], [[0.0, -0.45], [0.68, 0.16]], atol=1e-6)
    # The way to the middle of the goal is longer by the goal's tolerance.
    assert np.linalg.norm(np.diff(way, axis=0), axis=1).sum() == pytest.approx(finding["measured"], abs=2e-3)
    page = (tmp_path / "runs" / "closed" / "report.html").read_text(encoding="utf-8")
    assert page_data(page).marks[0]["kind"] == "way"
