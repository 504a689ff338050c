"""Problem files: what is read, in which units, and how defects are reported."""

import tomllib
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.core.errors import FileIssue, ProblemError, ProblemFileError
from ccm_opt.io.build import folded_bends
from ccm_opt.io.issues import locate_keys
from ccm_opt.io.reading import load_problem, parse_problem, problem_from_mapping
from ccm_opt.problem import JointPose, Problem, TipGoal
from ccm_opt.robot.arm import Arm

from .arms import plain_arm
from .conftest import PROBLEMS, SMALL_PROBLEM


def issues_of(text: str) -> tuple[FileIssue, ...]:
    """The defects that reading a text reports."""
    with pytest.raises(ProblemFileError) as caught:
        parse_problem(text, "problem.toml")
    return caught.value.issues


def changed(old: str, new: str) -> str:
    """The small problem with one piece of text replaced."""
    assert SMALL_PROBLEM.count(old) == 1
    return SMALL_PROBLEM.replace(old, new)


def line_holding(text: str, piece: str) -> int:
    """Line, from 1, of the first occurrence of ``piece``."""
    return text[: text.index(piece)].count("\n") + 1


@pytest.mark.parametrize("path", sorted(PROBLEMS.glob("*.toml")), ids=lambda path: path.stem)
def test_problems_of_the_project_load_and_rebuild_from_their_data(path: Path) -> None:
    """Every shipped problem loads, and its data alone give the same problem again."""
    problem = load_problem(path)
    again = problem_from_mapping(tomllib.loads(path.read_text()))
    assert problem.name == again.name == path.stem
    assert [(o.name, o.core.wkt, o.rounding) for o in problem.workspace.obstacles] == [
        (o.name, o.core.wkt, o.rounding) for o in again.workspace.obstacles
    ]
    np.testing.assert_array_equal(problem.limits.velocity, again.limits.velocity)


def test_defaults_are_those_of_the_format(small_problem: Problem) -> None:
    """What a file leaves out takes the documented default."""
    arm = small_problem.arm
    assert (arm.base_limit, arm.mount_length, arm.axes, arm.self_collision) == (2 * np.pi, arm.radius, "zyx", True)
    assert small_problem.tolerances.position == 1e-3
    assert small_problem.tolerances.heading == pytest.approx(np.pi / 180)
    assert small_problem.planner.method == "nlp"
    assert small_problem.limits.torque is None
    np.testing.assert_array_equal(small_problem.simulation.gravity, [0.0, 0.0, -9.81])
    np.testing.assert_allclose(arm.inertia_axial, 0.1 * 0.02**2 / 2)
    np.testing.assert_allclose(arm.inertia_transverse, 0.1 * (3 * 0.02**2 + 0.1**2) / 12)


def test_every_kind_of_obstacle_becomes_its_exact_set() -> None:
    """Polygon and box have no rounding; a circle is a rounded point, a wall a rounded line of half its thickness."""
    kinds = """\
[[workspace.obstacles]]
box = [0.5, 0.5, 0.6, 0.7]
[[workspace.obstacles]]
polygon = [[-0.5, 0.5], [-0.4, 0.5], [-0.5, 0.6]]
[[workspace.obstacles]]
wall = { points = [[-0.5, -0.5], [0.5, -0.5]], thickness = 0.02 }

[arm]"""
    obstacles = parse_problem(changed("[arm]", kinds)).workspace.obstacles
    assert [o.name for o in obstacles] == ["post", "obstacle 2", "obstacle 3", "obstacle 4"]
    assert [o.core.geom_type for o in obstacles] == ["Point", "Polygon", "Polygon", "LineString"]
    assert [o.rounding for o in obstacles] == [0.1, 0.0, 0.0, 0.01]
    assert shapely.area(obstacles[1].core) == pytest.approx(0.02)


@pytest.mark.parametrize(("units", "metres"), [("m", 1.0), ("mm", 1e-3), ("in", 0.0254)])
def test_units_scale_every_length_and_curvatures_inversely(units: str, metres: float) -> None:
    """A file in other units, its numbers divided by the metres of a unit, is the same problem."""
    segments = "segments = [{{ length = {0}, curvature = [{1}, {1}, 0.0, 0.0, 0.0] }}]"
    in_metres = changed('shape = "straight"', segments.format(0.4, 2.0)) + "position_tolerance = 0.002\n"
    length = f"{0.4 / metres!r}"
    text = f"""\
schema = 1
name = "small"
units = "{units}"
[workspace]
bounds = [{-1 / metres!r}, {-1 / metres!r}, {1 / metres!r}, {1 / metres!r}]
[[workspace.obstacles]]
name = "post"
circle = {{ center = [0.0, {0.3 / metres!r}], radius = {0.1 / metres!r} }}
[arm]
links = 4
link_length = {0.1 / metres!r}
radius = {0.02 / metres!r}
base = [0.0, 0.0]
joint_limit_deg = 60.0
[limits]
velocity = 2.0
acceleration = 10.0
[start]
{segments.format(length, 2.0 * metres)}
[goal]
position = [{0.3 / metres!r}, {0.1 / metres!r}]
position_tolerance = {0.002 / metres!r}
"""
    expected, got = parse_problem(in_metres), parse_problem(text)
    assert expected.start.curve is not None
    assert got.start.curve is not None
    assert isinstance(expected.goal, TipGoal)
    assert isinstance(got.goal, TipGoal)
    np.testing.assert_allclose(got.start.curve.tip[0], expected.start.curve.tip[0], rtol=1e-12)
    np.testing.assert_allclose(got.goal.position, expected.goal.position, rtol=1e-12)
    np.testing.assert_allclose(shapely.bounds(got.workspace.boundary), shapely.bounds(expected.workspace.boundary))
    assert got.workspace.obstacles[0].rounding == pytest.approx(0.1)
    assert (got.arm.length, got.arm.radius, got.arm.mount_length) == pytest.approx((0.4, 0.02, 0.02))
    assert got.tolerances.position == pytest.approx(0.002)
    np.testing.assert_array_equal(got.limits.velocity, expected.limits.velocity)


def test_limits_take_one_value_one_a_ball_or_one_a_revolute() -> None:
    """A ball joint's value holds for its three revolutes."""
    text = changed("velocity = 2.0", "velocity = [1, 2, 3, 4]\ntorque = [1,2,3,4,5,6,7,8,9,10,11,12]")
    limits = parse_problem(text).limits
    np.testing.assert_array_equal(limits.velocity, [1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4])
    np.testing.assert_array_equal(limits.acceleration, np.full(12, 10.0))
    assert limits.torque is not None
    np.testing.assert_array_equal(limits.torque, np.arange(1, 13))


def test_whole_arm_goals_become_poses() -> None:
    """A goal by joints is a joint pose, in radians."""
    goal = parse_problem(changed("position = [0.3, 0.1]", "joints_deg = [90, 0, -30, 30]")).goal
    assert isinstance(goal, JointPose)
    np.testing.assert_allclose(goal.bends, np.deg2rad([90, 0, -30, 30]))


DEFECTS = {
    "odd links": ("links = 4", "links = 5", "arm.links", "even number"),
    "too many links": ("links = 4", "links = 402", "arm.links", "at most 400"),
    "fractional links": ("links = 4", "links = 4.0", "arm.links", "whole number"),
    "wrong type": ("radius = 0.02", 'radius = "thin"', "arm.radius", "expected a number, got 'thin'"),
    "a flag is no number": ("radius = 0.02", "radius = true", "arm.radius", "expected a number, got true"),
    "not a number": ("radius = 0.02", "radius = nan", "arm.radius", "finite"),
    "infinite": ("velocity = 2.0", "velocity = inf", "limits.velocity", "positive number"),
    "negative radius": ("radius = 0.02", "radius = -0.02", "arm.radius", "at least 0"),
    "zero link": ("link_length = 0.1", "link_length = 0", "arm.link_length", "greater than 0"),
    "wide joint": ("joint_limit_deg = 60.0", "joint_limit_deg = 181", "arm.joint_limit_deg", "at most 180"),
    "unknown key": (
        "radius = 0.02",
        "radius = 0.02\ncolour = 3",
        "arm.colour",
        "unknown key 'colour'; valid keys here: ",
    ),
    "misspelt key": ("link_length", "link_lenght", "arm.link_lenght", "did you mean 'link_length'"),
    "misplaced key": ("[limits]", "[limits]\ngravity = [0, 0, -9.81]", "limits.gravity", "expected simulation.gravity"),
    "deeply misplaced key": ("[limits]", "[limits]\nduration = 1.0", "limits.duration", "planner.weights.duration"),
    "another word": (
        "[limits]",
        "[limits]\ndiameter = 1.0",
        "limits.diameter",
        "arm.radius, which is half the diameter",
    ),
    "a word that rhymes": (
        "[limits]",
        "[limits]\nfriction_of_all = 1",
        "limits.friction_of_all",
        "valid keys here: velocity",
    ),
    "misspelt table": ("[limits]", "[limit]", "limit", "did you mean 'limits'"),
    "crossing outline": (
        "circle = { center = [0.0, 0.3], radius = 0.1 }",
        "polygon = [[0.5, 0.5], [0.7, 0.9], [0.7, 0.5], [0.5, 0.7]]",
        "workspace.obstacles[0].polygon",
        "crosses",
    ),
    "flat outline": (
        "circle = { center = [0.0, 0.3], radius = 0.1 }",
        "polygon = [[0.5, 0.5], [0.6, 0.6], [0.7, 0.7]]",
        "workspace.obstacles[0].polygon",
        "no area",
    ),
    "two kinds": (
        "circle = { center",
        "box = [0.5, 0.5, 0.6, 0.6]\ncircle = { center",
        "workspace.obstacles[0].circle",
        "exactly one of polygon, box, circle, wall, points; got box and circle",
    ),
    "no kind": (
        "circle = { center = [0.0, 0.3], radius = 0.1 }",
        "",
        "workspace.obstacles[0]",
        "exactly one of polygon, box, circle, wall, points; got none",
    ),
    "reversed box": ("bounds = [-1.0, -1.0, 1.0, 1.0]", "bounds = [1, -1, -1, 1]", "workspace.bounds", "xmin < xmax"),
    "short list": ("base = [0.0, 0.0]", "base = [0.0]", "arm.base", "exactly 2 entries, got 1"),
    "four curvatures": (
        'shape = "straight"',
        "segments = [{ length = 0.4, curvature = [0, 0, 0, 0] }]",
        "start.segments[0].curvature",
        "exactly 5 entries, got 4",
    ),
    "text in an array": ("base = [0.0, 0.0]", 'base = [0.0, "low"]', "arm.base[1]", "a number, got the string 'low'"),
    "list in limits": ("velocity = 2.0", "velocity = [[2], 2, 2, 2]", "limits.velocity", "[0] is the list [2]"),
    "flag in limits": ("velocity = 2.0", "velocity = [2, true, 2, 2]", "limits.velocity", "[1] is true"),
    "date in limits": ("velocity = 2.0", "velocity = [1979-05-27]", "limits.velocity", "the date or time 1979-05-27"),
    "limits of another arm": ("velocity = 2.0", "velocity = [1, 2]", "limits.velocity", "4 or 12 in all; got 2"),
    "two starts": (
        'shape = "straight"',
        'shape = "straight"\njoints_deg = [0,0,0,0]',
        "start.joints_deg",
        "exactly one",
    ),
    "heading of a shape": (
        'shape = "straight"',
        'shape = "straight"\nheading_deg = 1',
        "start.heading_deg",
        "segments",
    ),
    "past the joint limit": (
        'shape = "straight"',
        "joints_deg = [0, 0, 61, 0]",
        "start.joints_deg[2]",
        "61° exceeds",
    ),
    "short curve": (
        'shape = "straight"',
        "segments = [{ length = 0.3, curvature = [0, 0, 0, 0, 0] }]",
        "start.segments",
        "add up to 0.3 m; expected the arm's length",
    ),
    "falling knots": (
        'shape = "straight"',
        "segments = [{ length = 0.4, curvature = [0, 0, 0, 0, 0], knots = [0.5, 0.4, 0.6] }]",
        "start.segments[0].knots",
        "increasing",
    ),
    "unsafe name": ('name = "small"', 'name = "../small"', "name", "a name that can be a folder's"),
    "future schema": ("schema = 1", "schema = 2", "schema", "expected 1"),
    "feed without limits": (
        "links = 4",
        "links = 4\nfeed = { range = [0, 1] }",
        "limits.feed_velocity",
        "an arm with a feed axis needs this limit",
    ),
    "reversed feed": ("links = 4", "links = 4\nfeed = { range = [1, 0] }", "arm.feed.range", "lower < upper"),
    "limit of no feed": ("velocity = 2.0", "velocity = 2.0\nfeed_force = 3", "limits.feed_force", "with arm.feed"),
    "start on no feed": ('shape = "straight"', 'shape = "straight"\nfeed = 0.1', "start.feed", "with arm.feed"),
    "scene file": ("[workspace]", '[workspace]\nfile = "scene.svg"', "workspace.file", "was not read from a file"),
    "base in an obstacle": ("base = [0.0, 0.0]", "base = [0.0, 0.25]", "arm.base", "0.05 m inside 'post'"),
    "base outside": ("base = [0.0, 0.0]", "base = [-1.25, 0]", "arm.base", "0.25 m outside the workspace boundary"),
}


@pytest.mark.parametrize("name", DEFECTS)
def test_a_defect_is_reported_with_key_path_and_line(name: str) -> None:
    """Each defect is found, named by its key path, explained, and placed on its own line."""
    old, new, key, message = DEFECTS[name]
    text = changed(old, new)
    found = [issue for issue in issues_of(text) if issue.key == key]
    assert found, issues_of(text)
    assert message in found[0].message
    word = key.rsplit(".", 1)[-1].split("[")[0]
    pieces = {
        "obstacles": "\n[[workspace.obstacles]]",
        "limit": "\n[limit]",
        "knots": "\nsegments = ",
        "curvature": "\nsegments = ",
        "range": "\nfeed = ",
        "feed_velocity": "\n[limits]",
    }
    piece = pieces.get(word, f"\n{word} = ")
    assert found[0].line == line_holding("\n" + text, piece)


@pytest.mark.parametrize(("name", "key"), [('name = "post"\n', ".name"), ("", "")])
def test_two_obstacles_of_one_name_are_refused(name: str, key: str) -> None:
    """The second one is pointed at, also when its place gave it the name of an earlier one."""
    first = "post" if name else "obstacle 2"
    text = SMALL_PROBLEM.replace('"post"', f'"{first}"')
    text = text.replace("[arm]", f"[[workspace.obstacles]]\n{name}box = [0.5, 0.5, 0.6, 0.7]\n\n[arm]")
    (issue,) = issues_of(text)
    assert issue.key == f"workspace.obstacles[1]{key}"
    assert f"the name '{first}' is taken by workspace.obstacles[0]" in issue.message
    assert issue.line == line_holding(text, "box = ") - 1


def test_a_directory_is_no_drawing(tmp_path: Path) -> None:
    """A path that leads to a directory is called one, as the user wrote it."""
    (tmp_path / "problem.toml").write_text(changed("[workspace]", '[workspace]\nfile = "."'))
    with pytest.raises(ProblemFileError, match=r"workspace\.file: '\.' is a directory; expected a drawing"):
        load_problem(tmp_path / "problem.toml")


def test_all_defects_are_reported_at_once_in_order_of_lines() -> None:
    """Several defects in several tables come in one error, each once."""
    text = (
        SMALL_PROBLEM.replace("links = 4", "links = 5")
        .replace("radius = 0.02", "raduis = 0.02")
        .replace("velocity = 2.0", "velocity = -2.0")
        .replace("position = [0.3, 0.1]", 'position = [0.3, "b"]')
    )
    issues = issues_of(text + "\n[planner]\nmethod = 'hill climbing'\n")
    assert [issue.key for issue in issues] == [
        "arm.links",
        "arm.raduis",
        "limits.velocity",
        "goal.position[1]",
        "planner.method",
    ]
    assert "hill-climbing" in issues[-1].message


def test_places_are_checked_although_another_table_is_defective() -> None:
    """An unknown key elsewhere does not hide that the base is inside an obstacle."""
    text = changed("base = [0.0, 0.0]", "base = [0.0, 0.25]") + "[simulation]\nstepp = 1\n"
    assert {issue.key for issue in issues_of(text)} == {"arm.base", "simulation.stepp"}


@pytest.mark.parametrize("place", ["[0.5, 0.0]", "[0.0, 0.3]", "[0.0, 0.19]"])
def test_a_goal_that_cannot_be_reached_is_no_defect_of_the_file(place: str) -> None:
    """Out of reach, inside an obstacle, too near to one: the planner explains it, the file is sound."""
    assert parse_problem(changed("position = [0.3, 0.1]", f"position = {place}"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b" \n\t\n", "the file is empty"),
        (b"\x7fELF\x02\x01\xff\xfe\x00", "not a text file in UTF-8"),
        (b"schema = 1\nname = \n", "not valid TOML"),
        (b"a = " + b"[" * 20000, "nested too deeply"),
        (b"a = " + b"1" * 5000, "unusable TOML"),
    ],
)
def test_unreadable_files_get_one_clear_sentence(tmp_path: Path, content: bytes, message: str) -> None:
    """A file that is no TOML text is refused with the reason."""
    path = tmp_path / "problem.toml"
    path.write_bytes(content)
    with pytest.raises(ProblemFileError, match=message):
        load_problem(path)


JUNK = (None, True, -1, 1e300, 10**400, float("nan"), "", [], [1], [[0, 0], [1, 1]], {}, [{}], [None])


@pytest.mark.parametrize("junk", JUNK, ids=repr)
def test_no_value_of_any_key_ends_in_another_error(junk: object) -> None:
    """Whatever stands in place of a value is either usable or a ``ProblemFileError``."""
    data = tomllib.loads(SMALL_PROBLEM)
    places = [(table, key) for table in data for key in (data[table] if isinstance(data[table], dict) else ())]
    for table, key in [*places, *((None, key) for key in data)]:
        changed_data = {**data, key: junk} if table is None else {**data, table: {**data[table], key: junk}}
        try:
            assert isinstance(problem_from_mapping(changed_data), Problem)
        except ProblemFileError as error:
            assert error.issues  # noqa: PT017 - both outcomes are sound


def test_missing_files_and_directories_are_named(tmp_path: Path) -> None:
    """A path without a file behind it is refused with the path in the message."""
    with pytest.raises(ProblemFileError, match=r"missing\.toml(.|\n)*no such file"):
        load_problem(tmp_path / "missing.toml")
    with pytest.raises(ProblemFileError, match="this is a directory"):
        load_problem(tmp_path)


def test_syntax_errors_have_their_line() -> None:
    """A TOML syntax error is reported on the line where it stands."""
    assert [issue.line for issue in issues_of("schema = 1\nname == 2\n")] == [2]


def test_windows_files_with_a_byte_order_mark_are_read(tmp_path: Path) -> None:
    """A byte order mark and carriage returns do not matter, nor do they shift lines."""
    path = tmp_path / "problem.toml"
    path.write_bytes(b"\xef\xbb\xbf" + SMALL_PROBLEM.replace("\n", "\r\n").encode())
    assert load_problem(path).name == "small"
    text = changed("links = 4", "links = 5")
    assert issues_of(text.replace("\n", "\r\n"))[0].line == line_holding(text, "links = 5")


def test_lines_are_found_through_every_way_to_write_a_key() -> None:
    """Dotted and quoted keys, nested arrays over several lines, inline tables, strings with brackets, comments."""
    text = '''\
top = "a # no comment ] = "  # a comment [x]
dotted . "quoted.key" = 1
[table."sub table"]
long = """
[not.a.table]
"""
points = [
  [1, 2],  # first
  [3,
   4],
]
inline = { a = 1, b = { c = [5, 6] } }
[[many]]
x = 1
[[many]]
x = 2979-05-27 07:32:00
[many.child]
y = 'z'
'''
    tomllib.loads(text)
    lines = locate_keys(text)
    assert lines["top",] == 1
    assert lines["dotted", "quoted.key"] == 2
    assert lines["table", "sub table", "long"] == 4
    assert lines["table", "sub table", "points", 0] == 8
    assert lines["table", "sub table", "points", 1, 1] == 10
    assert lines["table", "sub table", "inline", "b", "c", 1] == 12
    assert lines["many", 0, "x"] == 14
    assert lines["many", 1, "x"] == 16
    assert lines["many", 1, "child", "y"] == 18


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@settings(max_examples=25, deadline=None)
@given(
    links=st.integers(2, 60).map(lambda half: 2 * half),
    radius=st.sampled_from([0.0, 0.1, 0.3, 0.5, 0.8, 1.5]),
    limit=st.floats(20.0, 180.0),
)
def test_a_folded_arm_keeps_its_limits_and_distant_links_two_radii_apart(
    links: int, radius: float, limit: float
) -> None:
    """A fold stays within the joint limit and clear of itself, or the arm is said to be unfoldable."""
    arm = unit_arm(links, radius, limit)
    try:
        bends = folded_bends(arm)
    except ProblemError:
        return
    points = arm.joint_positions(arm.headings(bends))
    axes = [shapely.LineString(points[k : k + 2]) for k in range(links)]
    pairs = [(i, j) for i in range(links) for j in range(i) if (i - j - 1) >= max(2.0, np.pi * radius)]
    assert np.abs(bends[1:]).max() <= arm.joint_limit
    assert all(axes[i].distance(axes[j]) > 2.0 * radius for i, j in pairs)


@pytest.mark.parametrize("links", [6, 12, 24, 48, 96])
def test_a_folded_arm_is_compact(links: int) -> None:
    """With usual limits an arm can be folded, and fits into a circle shorter than itself."""
    arm = unit_arm(links, 0.5, 60.0)
    points = arm.joint_positions(arm.headings(folded_bends(arm)))
    assert np.ptp(points, axis=0).max() < {6: 0.75, 12: 0.55}.get(links, 0.35) * arm.length


def test_an_arm_too_short_to_fold_is_refused() -> None:
    """Two links cannot make half a turn of two bends; the message says what to do instead."""
    issues = issues_of(
        changed("links = 4", "links = 2").replace('"straight"', '"folded"').replace("[0.3, 0.1]", "[0.1, 0.1]")
    )
    assert [issue.key for issue in issues] == ["start.shape"]
    assert "joints_deg" in issues[0].message


def unit_arm(links: int, radius: float, limit_deg: float) -> Arm:
    """An arm of unit links."""
    return plain_arm(links, 1.0, radius, joint_limit=np.deg2rad(limit_deg), mount_length=radius)
