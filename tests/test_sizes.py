"""Which arm: bounds of sizes against the shortest ways by geometry, and what the command finds, proves and refuses."""

import csv
import json
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.optimize import brentq
from typer.testing import CliRunner

from ccm_opt import load_problem
from ccm_opt.cli.commands import app
from ccm_opt.cli.sizing import front_lines, size_sentence
from ccm_opt.core.errors import ProblemError
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.last_link import last_link_is_led_to
from ccm_opt.diagnosis.sizes import SIZES, Proofs, size_of
from ccm_opt.driver.settings import DEFAULT_SETTINGS
from ccm_opt.driver.size_search import SizeSearch
from ccm_opt.ik.shortest_arm import shortest_arm
from ccm_opt.io.reading import parse_problem
from ccm_opt.io.size_files import front_files
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.solution import ArmSize, SizeFront, SizeTrial
from ccm_opt.viz.size_picture import size_png

from .conftest import PROBLEMS, make_solution

FENCE = """
schema = 1
name = "fence"

[workspace]
bounds = [-1.0, -2.0, 2.0, 2.0]

[[workspace.obstacles]]
name = "fence"
wall = {{ points = [[{at}, -2.0], [{at}, {top}]], thickness = 1e-3 }}

[arm]
links = 12
link_length = 0.1
radius = {radius}
base = [0.0, 0.0]
joint_limit_deg = 80.0

[limits]
velocity = 2.0
acceleration = 10.0

[start]
shape = "straight"

[goal]
position = [{goal}, 0.0]

[planner]
time_limit = 30.0
"""
"""An arm before a fence, upright where it starts, with its goal behind it: the way leads round the top of the fence."""


def fence(at: float = 0.3, top: float = 0.2, radius: float = 0.02, goal: float = 0.6) -> Problem:
    """The problem, with a start that is clear of the fence."""
    text = FENCE.format(at=at, top=top, radius=radius, goal=goal)
    return parse_problem(text.replace("base = [0.0, 0.0]", "base = [0.0, 0.0]\nbase_heading_deg = 90.0"), "fence.toml")


def round_disc(goal: float, at: float, top: float, radius: float) -> float:
    """Length of the shortest way from the origin to (goal, 0) above a disc about (at, top): two tangents and an arc."""
    ends, middle = np.array([[0.0, 0.0], [goal, 0.0]]), np.array([at, top])
    apart = np.linalg.norm(ends - middle, axis=1)
    between = ends - middle
    below = np.arccos(np.clip(between[0] @ between[1] / apart.prod(), -1.0, 1.0))
    arc = 2.0 * np.pi - below - np.arccos(radius / apart).sum()
    return float(np.sqrt(apart**2 - radius**2).sum() + radius * arc)


@settings(max_examples=5, deadline=None)
@given(at=st.floats(0.25, 0.45), top=st.floats(0.1, 0.4), radius=st.floats(0.01, 0.06))
def test_the_proved_length_is_that_of_the_way_round_a_disc(at: float, top: float, radius: float) -> None:
    """No length is proved too short that the shortest way by geometry needs not, and all but 1 % of that is proved."""
    problem = fence(at, top, radius, goal=0.7)
    size = SIZES["length"]
    given = size.parameter.read(problem)
    proofs = Proofs(problem, size, size.hardest * given, 0.0, 5.0)
    proved = proofs.easiest(size.nearest * given, 0.005)
    assert proved is not None
    # The wall is as thick as a thousandth, the tip ends at the edge of its tolerance, inscribed arcs lose 0.2 % of
    # their radius, and a proof ends at the latest half a percent before it could.
    shortest = round_disc(0.7, at, top, radius) - problem.tolerances.position
    assert 0.99 * shortest - 2e-3 <= problem.arm.links * proved <= shortest + 4e-3
    assert proofs.holds(0.7 * proved)[0]


@settings(max_examples=6, deadline=None)
@given(
    bends=st.lists(st.floats(-0.6, 0.2), min_size=12, max_size=12),
    at=st.floats(0.2, 0.5),
    top=st.floats(-0.5, 0.5),
    longer=st.floats(1.0, 1.5),
)
def test_no_arm_in_a_free_pose_nor_a_longer_one_is_proved_too_short(
    bends: list[float], at: float, top: float, longer: float
) -> None:
    """A pose beside the fence has the length that its goal, with the direction of its last link, takes."""
    problem = fence(at, top)
    points = problem.arm.joint_positions_at(np.array(bends))
    wall = shapely.LineString([(at, -2.0), (at, top)]).buffer(0.5e-3, cap_style="flat")
    room = shapely.box(-1.0, -2.0, 2.0, 2.0).buffer(-problem.arm.radius)
    axis = shapely.LineString(points)
    if shapely.distance(axis, wall) < problem.arm.radius or not shapely.covers(room, axis):
        return
    along = problem.arm.link_rotations(np.array(bends))[-1, :, 0]
    posed = replace(problem, goal=TipGoal(points[-1], along))
    asked = SIZES["length"].at(posed, longer * problem.arm.link_length)
    assert not failed(asked, (last_link_is_led_to,))


def test_the_last_link_makes_arms_longer_that_come_from_ahead() -> None:
    """The arm over the fence ends upright: it needs the way to a link's length below its goal, and that link."""
    problem = fence()
    problem = replace(problem, goal=TipGoal(np.array([0.6, 0.0]), np.array([0.0, 1.0])))
    size = SIZES["length"]
    proofs = Proofs(problem, size, size.hardest * 0.1, 0.0, 5.0)
    proved = proofs.easiest(size.nearest * 0.1, 0.002)
    assert proved is not None
    plain = round_disc(0.6, 0.3, 0.2, 0.02)
    assert 12.0 * proved > plain + 1.2 * proved
    assert "its last link lies along the goal's direction" in proofs.findings(proved)[0].reason


def arched(problem: Problem) -> np.ndarray:
    """Bends, shape (n,), of the regular arc of an arm from its base, upright or so, to a goal on the x axis."""
    n, length = problem.arm.links, problem.arm.link_length
    away = float(problem.goal.tip(problem.arm)[0])
    bend = brentq(lambda b: length * np.sin(0.5 * n * b) / np.sin(0.5 * b) - away, 1e-6, 2.0 * np.pi / n)
    return np.append(0.5 * (n - 1) * bend - problem.arm.base_heading, np.full(n - 1, -bend))


@settings(max_examples=3, deadline=None)
@given(at=st.floats(0.25, 0.35), top=st.floats(0.1, 0.3), radius=st.floats(0.01, 0.05), slack=st.floats(0.0, 0.3))
def test_the_shortest_arm_has_a_free_pose_no_shorter_than_the_shortest_way(
    at: float, top: float, radius: float, slack: float
) -> None:
    """Measured by shapely: the pose reaches the goal clear of the fence; no arm beats the way by geometry."""
    problem = fence(at, top, radius)
    found = shortest_arm(problem, arched(problem), slack)
    if found is None:
        return
    arm = replace(problem.arm, link_length=found.link_length)
    points = arm.joint_positions_at(found.configuration)
    assert np.linalg.norm(points[-1] - [0.6, 0.0]) <= problem.tolerances.position
    assert np.all(np.abs(found.configuration) <= arm.bend_limits)
    wall = shapely.LineString([(at, -2.0), (at, top)]).buffer(0.5e-3, cap_style="flat")
    mount = shapely.Point(0.0, 0.0).buffer(arm.mount_length)
    assert shapely.distance(shapely.LineString(points).difference(mount), wall) >= radius - 1e-9
    assert arm.length >= round_disc(0.6, at, top, radius) - problem.tolerances.position


def test_the_shortest_arm_is_hardly_longer_than_the_shortest_way() -> None:
    """With links that bend as far as the way does, the arm is longer by the corners of its links alone; or as asked."""
    problem = fence()
    found = shortest_arm(problem, arched(problem), 0.0)
    assert found is not None
    assert found.link_length * problem.arm.links <= 1.02 * round_disc(0.6, 0.3, 0.2, 0.02)
    longer = shortest_arm(problem, arched(problem), 0.0, least=0.08)
    assert longer is not None
    assert longer.link_length == pytest.approx(0.08, rel=1e-6)


def test_a_proof_for_a_radius_excuses_the_mount_of_the_thickest() -> None:
    """The arms of thicker radius, whose mounts are longer, are covered by the proof for a thinner one."""
    problem = fence()
    proofs = Proofs(problem, SIZES["radius"], 0.08, 0.08, 5.0)
    assert proofs.relaxed(0.03).arm.mount_length == pytest.approx(0.08)
    assert proofs.relaxed(0.03).arm.radius == pytest.approx(0.03)


def test_links_like_those_there_are_are_added() -> None:
    """An arm of other links is one that a file with that number describes."""
    problem = fence()
    wanted = parse_problem(
        FENCE.format(at=0.3, top=0.2, radius=0.02, goal=0.6)
        .replace("links = 12", "links = 18")
        .replace("base = [0.0, 0.0]", "base = [0.0, 0.0]\nbase_heading_deg = 90.0"),
        "fence.toml",
    )
    changed = SIZES["links"].at(problem, 18.0)
    for name in ("links", "masses", "inertia_axial", "inertia_transverse", "length"):
        assert np.array_equal(getattr(changed.arm, name), getattr(wanted.arm, name))
    assert np.array_equal(changed.limits.velocity, wanted.limits.velocity)
    assert np.array_equal(changed.start.bends, wanted.start.bends)


def test_what_is_tied_to_the_size_is_named() -> None:
    """Starts and goals along curves, differing links and bent starts have no other length or number of links."""
    with pytest.raises(ProblemError, match="segments of the arm's length"):
        size_of(load_problem(PROBLEMS / "fork.toml"), "length")
    problem = fence()
    heavy = replace(problem, arm=replace(problem.arm, masses=np.arange(1.0, 13.0)))
    with pytest.raises(ProblemError, match=r"arm\.masses differs between links"):
        size_of(heavy, "links")
    bent = replace(problem, start=replace(problem.start, bends=np.full(12, 0.1)))
    with pytest.raises(ProblemError, match="start: the start bends the joints of 12 links"):
        size_of(bent, "links")
    assert size_of(bent, "length").name == "length"


def test_a_search_ends_at_the_hardest_value(monkeypatch: pytest.MonkeyPatch) -> None:
    """An arm with room to grow is made no thicker than the thickest of the search, beyond which nothing is tried."""
    problem = fence()
    solution = make_solution(problem, np.zeros(12))
    monkeypatch.setattr("ccm_opt.driver.size_search.held", lambda *_: solution)
    monkeypatch.setattr("ccm_opt.driver.size_search.room_to_grow", lambda _: 1.0)
    trials: list[SizeTrial] = []
    search = SizeSearch(problem, SIZES["radius"], 1.0, pytest.fail, lambda _: None, 1, DEFAULT_SETTINGS, trials)
    search.proved = None
    search.keep(0.03, solution, long=True)
    assert search.easy == search.hardest == pytest.approx(0.08)
    search.easy *= 1.1
    search.narrow()


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--base-line", "0,0", "1,x"], "--base-line: expected x,y in m, got '1,x'"),
        (["--base-rectangle", "0,0", "0,1"], "--base-rectangle: the corners must differ in two coordinates"),
        (["--base-line", "0,0", "0,1", "--base-rectangle", "0,0", "1,1"], "give one of them"),
        (["--places", "3"], "--places has no effect without"),
        (["--pareto", "--find", "radius"], "leave out --find radius"),
        (["--pareto", "--base-line", "0,0", "0,1"], "--pareto is for one place"),
    ],
)
def test_options_without_effect_are_refused(options: list[str], reason: str, tmp_path: Path) -> None:
    """The command says which option is wrong and writes nothing."""
    file = tmp_path / "fence.toml"
    file.write_text(FENCE.format(at=0.3, top=0.2, radius=0.02, goal=0.6))
    printed = CliRunner().invoke(app, ["size", str(file), "--out", str(tmp_path / "out"), *options])
    assert printed.exit_code == 2
    assert reason in printed.output
    assert not (tmp_path / "out").exists()


@pytest.mark.planning
def test_that_no_length_is_enough_is_a_result(tmp_path: Path) -> None:
    """A goal beyond twice the length is refused with the proof, and the record has the reason."""
    file = tmp_path / "fence.toml"
    text = FENCE.format(at=0.3, top=0.2, radius=0.02, goal=1.9).replace("link_length = 0.1", "link_length = 0.05")
    file.write_text(text)
    printed = CliRunner().invoke(app, ["size", str(file), "--out", str(tmp_path / "out"), "--no-pictures"])
    assert printed.exit_code == 3
    assert "even 1.2 m is too short" in printed.output
    record = json.loads((tmp_path / "out" / "fence" / "solution.json").read_text())
    assert record["status"] == "infeasible"


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_the_least_length_at_the_best_place_is_found_written_and_proved(tmp_path: Path) -> None:
    """The folder has a verified plan, the record the next length with its reason, the table every trial.

    Of two places of the base, the one behind the fence is proved to be the worse.
    """
    file = tmp_path / "fence.toml"
    text = FENCE.format(at=0.3, top=0.05, radius=0.02, goal=0.6).replace("link_length = 0.1", "link_length = 0.045")
    file.write_text(text.replace("base = [0.0, 0.0]", "base = [0.0, 0.0]\nbase_heading_deg = 90.0"))
    out = ["--out", str(tmp_path / "out"), "--no-pictures", "--base-line", "0,-0.2", "0.2,0.3", "--places", "2"]
    printed = CliRunner().invoke(app, ["size", str(file), *out, "--json"])
    assert printed.exit_code == 0, printed.output
    (result,) = json.loads(printed.stdout)["results"]
    folder = tmp_path / "out" / "fence"
    with (folder / "size.csv").open() as table:
        trials = list(csv.DictReader(table))
    enough = result["enough"]["length"]
    assert enough == min(float(each["length"]) for each in trials if each["outcome"] == "verified")
    assert (result["places"], result["places_proved"]) == (2, 1)
    assert result["enough"]["base"] == pytest.approx([0.2, 0.3])
    assert result["bound"]["outcome"] == "impossible"
    assert result["bound"]["length"] < enough < 1.1 * result["bound"]["length"]
    assert result["following"]["length"] >= result["bound"]["length"]
    assert json.loads((folder / "solution.json").read_text())["problem"]["arm"]["link_length"] * 12 == pytest.approx(
        enough
    )
    checked = CliRunner().invoke(app, ["check", str(folder), "--quiet"])
    assert checked.exit_code == 0, checked.output


def made_up_size(problem: Problem, length: float, *, proved: bool) -> ArmSize:
    """A size of which only the length counts, with a shorter arm for which there is no plan."""
    solution = make_solution(problem, np.full(problem.arm.links, 0.1))
    arm = replace(problem.arm, link_length=length / problem.arm.links)
    solution = replace(solution, problem=replace(problem, arm=arm))
    shorter = replace(
        SizeTrial.of(solution.problem, "not found", "no motion; and so on", limit=4.0), length=0.9 * length
    )
    bound = replace(shorter, outcome="impossible", reason="the way is longer", length=0.8 * length)
    return ArmSize("length", solution, bound if proved else shorter, bound, (shorter, bound))


def test_what_is_proved_and_what_was_not_found_are_told_apart(small_problem: Problem) -> None:
    """Of a size that was not found it is said for how long, and no more; of one with a proof that it is proved."""
    words = size_sentence(made_up_size(small_problem, 0.5, proved=False), "there")
    assert words == (
        "0.5 m is enough (plan in there); with 0.45 m no plan was found within 4 s of CPU time: no motion; "
        "0.4 m is too short: the way is longer (proved)"
    )
    words = size_sentence(made_up_size(small_problem, 0.5, proved=True), "there")
    assert words == "0.5 m is enough (plan in there); 0.4 m is too short: the way is longer (proved)"
    close = made_up_size(small_problem, 0.5, proved=True)
    bound = replace(close.trials[1], length=0.499996)
    words = size_sentence(replace(close, following=bound, bound=bound), "there")
    assert words.startswith("0.5 m is enough (plan in there); 0.499996 m is too short")


@pytest.mark.planning
def test_the_front_is_drawn_and_written_with_what_was_not_found(small_problem: Problem) -> None:
    """The picture, the lines and the record know radii with a plan, without one, and proved impossible."""
    size = made_up_size(small_problem, 0.5, proved=False)
    closed = SizeTrial.of(small_problem, "impossible", "no way is wide enough")
    bounds = (size.bound, None, replace(closed, radius=0.05, length=2.0))
    reasons = ("", "no motion was found", "no way is wide enough")
    front = SizeFront(small_problem, (0.01, 0.03, 0.05), (size, None, None), bounds, reasons, size.trials)
    picture = Image.open(BytesIO(size_png(front)))
    assert picture.width > picture.height > 200
    lines = front_lines(front, Path("there"))
    assert [line.endswith("(proved)") for line in lines] == [True, False, True]
    record = json.loads(front_files(front)["size.json"])
    assert [row["enough"] is None for row in record["radii"]] == [False, True, True]
    assert f"{record['radii'][0]['folder']}/solution.json" in front_files(front)
