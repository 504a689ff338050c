"""Keys of problem files set from outside: each reads back as set, the rest stays, and what leads nowhere is refused."""

import tomllib
from pathlib import Path

import pytest
import tomlkit
from hypothesis import given
from hypothesis import strategies as st

from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.io.issues import lookup
from ccm_opt.io.problem_data import recorded_data
from ccm_opt.io.reading import load_problem, with_keys_set

from .conftest import PROBLEMS

TEXT = """
# A comment that stays.
name = "x"
[arm]
radius = 0.02  # of a hose
[[workspace.obstacles]]
name = "post"
circle = { center = [0.0, 0.3], radius = 0.1 }
[[workspace.obstacles]]
name = "wall"
box = [0, 0, 1, 1]
[[goal]]
position = [1.0, 2.0]
"""
PATHS = {
    "arm.radius": ("arm", "radius"),
    "workspace.obstacles[0].circle.radius": ("workspace", "obstacles", 0, "circle", "radius"),
    "workspace.obstacles[wall].box": ("workspace", "obstacles", 1, "box"),
    "goal[0].position": ("goal", 0, "position"),
    "planner.time_limit": ("planner", "time_limit"),
    "new.table.key": ("new", "table", "key"),
}
VALUES = st.one_of(
    st.floats(-1e6, 1e6),
    st.integers(-(10**9), 10**9),
    st.booleans(),
    st.lists(st.floats(-10.0, 10.0), max_size=3),
    st.text(st.characters(codec="ascii", categories=["L"]), min_size=1, max_size=8),
)


@given(settings=st.dictionaries(st.sampled_from(sorted(PATHS)), VALUES, min_size=1))
def test_keys_read_back_as_set(settings: dict[str, object]) -> None:
    """Every key has the value that it was set to, every other value is as it was, and comments stay."""
    text = with_keys_set(TEXT, [f"{key}={tomlkit.item(value).as_string()}" for key, value in settings.items()]).text
    data, before = tomllib.loads(text), tomllib.loads(TEXT)
    for key, path in PATHS.items():
        assert lookup(data, path) == settings.get(key, lookup(before, path))
    assert "# A comment that stays." in text


def test_a_bare_word_is_a_text() -> None:
    """Quotes are not asked for, as shells take them away."""
    assert (
        tomllib.loads(with_keys_set(TEXT, ["planner.method=hill-climbing"]).text)["planner"]["method"]
        == "hill-climbing"
    )


@pytest.mark.parametrize(
    ("setting", "reason"),
    [
        ("radius", "expected key=value"),
        ("=3", "expected key=value"),
        ("a[=2", "is not a key path"),
        ("arm.radius.x=1", "arm.radius is not a table"),
        ("workspace.obstacles[pole].box=1", "none is 'pole'; its names are post, wall"),
        ("workspace.obstacles[7].box=1", "has 2 entries"),
    ],
)
def test_settings_that_lead_nowhere_are_refused(setting: str, reason: str) -> None:
    """The setting is named, with what is there."""
    with pytest.raises(ProblemError, match=reason.replace("[", r"\[")):
        with_keys_set(TEXT, [setting])


def test_the_changed_problem_is_the_recorded_one() -> None:
    """The record of a plan holds the values that it was made with, and a wrong value is a defect of its key."""
    file = PROBLEMS / "swan-neck.toml"
    changed = load_problem(file, changes=["arm.radius=0.02", "units=mm", "arm.radius=0.021"])
    assert changed.arm.radius == pytest.approx(0.021e-3)
    assert changed.length_unit == "mm"
    assert lookup(recorded_data(changed), ("arm", "radius")) == 0.021
    with pytest.raises(ProblemFileError, match=r"--set arm\.colour=3: unknown key 'colour'"):
        load_problem(file, changes=["arm.colour=3"])


def test_a_wrong_setting_is_told_by_itself_and_the_files_defects_by_its_lines(tmp_path: Path) -> None:
    """What was set is no line of the file, and does not move the lines of what the file itself has wrong."""
    file = tmp_path / "wrong.toml"
    lines = (PROBLEMS / "swan-neck.toml").read_text().replace("links = 12", "links = 13").splitlines()
    file.write_text("\n".join(lines))
    with pytest.raises(ProblemFileError) as error:
        load_problem(file, changes=["goal.position=3", "limits.jerk=-1", "workspace.clearance=0.001"])
    told = {issue.key: str(issue) for issue in error.value.issues}
    assert told["goal.position"] == "--set goal.position=3: expected a list in brackets, got 3"
    assert told["limits.jerk"].startswith("--set limits.jerk=-1: ")
    assert told["arm.links"].startswith(f"line {lines.index('links = 13') + 1}: ")
