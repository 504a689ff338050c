"""The page and the film of a plan: self-contained, complete, and honest about what they show."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
import shapely
from PIL import Image

from ccm_opt.files.plotting.animation import motion_gif
from ccm_opt.files.report.page import report_html
from ccm_opt.freespace.workspace import Obstacle
from ccm_opt.solution import GoalPoseRecord, Solution, SurvivedError
from ccm_opt.verification.room_over_time import room_over_time


def page_data(page: str) -> dict[str, list[object]]:
    """What the page's script is given."""
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data: dict[str, list[object]] = json.loads(found[1])
    return data


def test_the_page_shows_the_whole_motion(small_solution: Solution) -> None:
    """The first and last pose of the page are those of the plan, and every check has its row."""
    page = report_html(small_solution)
    data = page_data(page)
    np.testing.assert_allclose(data["poses"][0], small_solution.joint_positions[0], atol=1e-5)
    np.testing.assert_allclose(data["poses"][-1], small_solution.joint_positions[-1], atol=1e-5)
    assert data["time"][-1] == pytest.approx(small_solution.trajectory.duration, abs=1e-4)
    # One more row is the verdict on the simulation.
    assert page.count("<tr><td>") == len(small_solution.checks) + 1 + len(small_solution.timings)
    assert page.count("<tr><td>simulation</td>") == 1
    assert "{{" not in page


def test_the_page_loads_nothing(small_solution: Solution) -> None:
    """No link, image or script of the page comes from elsewhere."""
    sources: list[tuple[str, str | None]] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            del tag
            sources.extend(pair for pair in attrs if pair[0] in {"src", "href"})

    Reader().feed(report_html(small_solution))
    assert sources == []


def beside_a_post(solution: Solution) -> Solution:
    """The same plan with a post 10 mm beside the last place of the tip, in an otherwise empty room."""
    arm = solution.problem.arm
    tip = solution.joint_positions[-1, -1] + np.array([0.0, arm.radius + 0.04])
    workspace = replace(solution.problem.workspace, obstacles=(Obstacle("post", shapely.Point(tip), 0.03),))
    return replace(solution, problem=replace(solution.problem, workspace=workspace))


def a_goal_pose(solution: Solution, *, reached: bool) -> GoalPoseRecord:
    """A record whose pose is the last of a solution."""
    headings = solution.problem.arm.headings(solution.trajectory.bend_angles)[-1]
    return GoalPoseRecord(
        reached=reached,
        reason="" if reached else "the way to it is <closed>",
        headings=headings,
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
    section = page[page.index("Why the arm ends here") : page.index("Every limit")]
    rows = re.findall(r"<tr><td>(.*?)</td><td class=n>(.*?)</td><td.*?>(.*?)</td></tr>", section)
    # Two rows of one link beside one wall are one line: 12 for an arm's length of 0.4 m are 0.03 for 1 mm.
    assert ("link 4 beside &#x27;post&#x27;", "0.03", "for 1 mm") in rows
    assert ("joint 2 at its limit to the left", "0.0087", "for 1°") in rows
    assert ("the torque that joint 1 may hold", "0.002", "for 1 % more") in rows
    assert ("your constraint &#x27;level&#x27;", "0.1", "for 1 of its unit") in rows
    assert len(rows) == 4 + len(record.costs) + len(record.curve.segments)
    assert "your cost &#x27;look &lt;ahead&gt;&#x27;" in section
    assert ("The motion ends in it" in section) == reached
    assert ("the way to it is &lt;closed&gt;" in section) != reached


def test_the_page_shows_the_room_over_time(small_solution: Solution) -> None:
    """The chart's curve has a point for every sample of the record, and the least gap stands beside it in words."""
    plan = beside_a_post(small_solution)
    room = room_over_time(plan.problem, plan.trajectory, 0.03)
    page = report_html(replace(plan, room=room))
    section = page[page.index("<h2>Room</h2>") : page.index("<h2>Over time</h2>")]
    (curve,) = re.findall(r'<path d="M([^"]*)" fill="none" stroke="#2a6f97"', section)
    assert len(curve.split("L")) == len(room.time)
    assert f"at {room.nearest.time:.2f} s, link {room.nearest.link} to" in section
    assert "wanted 30 mm" in section
    assert section.count("Less than wanted from") == len(room.short)
    assert page.count("pointer-events") == 1


def test_names_cannot_break_the_page(small_solution: Solution) -> None:
    """Markup in a description stands there as text."""
    named = replace(small_solution.problem, description="</script><b>bold</b>")
    page = report_html(replace(small_solution, problem=named))
    assert "<b>bold</b>" not in page
    assert "&lt;b&gt;bold" in page


def test_the_film_has_the_motion_in_real_time(small_solution: Solution) -> None:
    """Its frames last as long as the motion, and the first and last differ."""
    film = Image.open(BytesIO(motion_gif(small_solution)))
    shown = 0.0
    pictures = []
    for k in range(film.n_frames):
        film.seek(k)
        pictures.append(np.asarray(film.convert("RGB")))
        shown += film.info["duration"] / 1000.0
    assert shown - 0.9 == pytest.approx(small_solution.trajectory.duration, rel=0.15)
    assert np.any(pictures[0] != pictures[-1])


def test_the_page_says_what_a_plan_survives(small_solution: Solution) -> None:
    """Errors that a plan survives stand in a section in degrees and millimetres; without any it is gone."""
    joints = SurvivedError("joints", 0.01, "rad", "link 2 to 'wall' at t = 0.5000 s", 0.5, 2)
    walls = SurvivedError("walls", 0.02, "m", "nothing; larger errors are not looked at", limited=False)
    page = report_html(replace(small_solution, tolerance=(joints, walls)))
    assert "Errors of joints: up to 0.573°; limited by link 2 to &#x27;wall&#x27;" in page
    assert "up to at least 20 mm" in page
    assert "What it survives" not in report_html(replace(small_solution, tolerance=()))
