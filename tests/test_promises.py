"""Every promise has a check, and every check a mutation that it alone catches."""

import re
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from ccm_opt.cli import written_plans as checking
from ccm_opt.cli.outcome import NO_PLAN
from ccm_opt.io import schema
from ccm_opt.io.reading_back import AXES_SHAPES, CLEARANCE_SHAPES, DRIVE_ARRAYS, FEED_SHAPES, SHAPES, TOOL_TIP
from ccm_opt.io.text_agreement import NAMES

from .corruption.plans import Folder, write_plans
from .promises.cases import Mutation
from .promises.in_space import SPACE_MUTATIONS as BARE_MUTATIONS
from .promises.in_space import SPACE_UNHARMED as BARE_UNHARMED
from .promises.in_space_equipped import EQUIPPED_MUTATIONS, EQUIPPED_UNHARMED
from .promises.of_folders import FOLDER_MUTATIONS
from .promises.of_motions import MUTATIONS, TOOL_MUTATIONS, UNHARMED

PAGE = (Path(__file__).parent.parent / "docs" / "guarantees.md").read_text(encoding="utf-8")
TABLES = {
    "": schema.RootTable,
    "workspace": schema.WorkspaceTable,
    "workspace.obstacles": schema.ObstacleTable,
    "arm": schema.PlaneArmTable,
    "limits": schema.LimitsTable,
    "start": schema.PoseTable,
    "goal": schema.GoalTable,
    "planner": schema.PlannerTable,
    "simulation": schema.SimulationTable,
    "tolerance": schema.ToleranceTable,
    "verification": schema.VerificationTable,
}

SPACE_TABLES = TABLES | {
    "workspace": schema.SpaceWorkspaceTable,
    "workspace.obstacles": schema.SpaceObstacleTable,
    "arm": schema.SpaceArmTable,
    "start": schema.SpacePoseTable,
    "goal": schema.SpaceGoalTable,
}
SPACE_MUTATIONS = {
    name: (*BARE_MUTATIONS.get(name, ()), *EQUIPPED_MUTATIONS.get(name, ()))
    for name in (*BARE_MUTATIONS, *EQUIPPED_MUTATIONS)
}
SPACE_UNHARMED = (*BARE_UNHARMED, *EQUIPPED_UNHARMED)


def rows(heading: str) -> dict[str, tuple[str, ...]]:
    """Rows of the table below a heading of the page: the names in code of the first cell, and all cells."""
    part = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    lines = [line for line in part.splitlines() if line.startswith("|") and "---" not in line][1:]
    found = {}
    for line in lines:
        cells = tuple(cell.strip() for cell in line.strip("|").split(" | "))
        for name in re.findall(r"`([^`]+)`", cells[0]):
            found[name] = cells
    return found


def general(name: str) -> str:
    """The name of a check with N for the number of a stop, a via point or a base axis."""
    return re.sub(r"(stop |via |axis_)\d+", r"\1N", name)


def keys(prefix: str, model: type[BaseModel]) -> set[str]:
    """All keys of a table and of the tables in it, with their paths."""
    found = set()
    for name, field in model.model_fields.items():
        path = f"{prefix}.{field.alias or name}".lstrip(".")
        inner = models_in(field.annotation)
        if not inner:
            found.add(path)
        for part in inner:
            found |= keys(path, part)
    return found


def models_in(annotation: Any) -> list[type[BaseModel]]:
    """Tables that a type allows."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def test_every_key_of_the_problem_file_has_a_row() -> None:
    """A key that is new, and what holds it, has to be entered in the docs; a row of a key that is gone has to go."""
    wanted = set().union(*(keys(prefix, model) for prefix, model in TABLES.items())) - set(TABLES)
    assert set(rows("Keys of the problem file")) == wanted


def test_every_key_in_space_has_a_row() -> None:
    """What arms in space have of their own has a row too; a row says what holds a key there, or the plane's does."""
    own, planar = rows("Keys in space"), rows("Keys of the problem file")
    wanted = set().union(*(keys(prefix, model) for prefix, model in SPACE_TABLES.items())) - set(SPACE_TABLES)
    assert set(own) <= wanted
    known = {*SPACE_MUTATIONS, *FOLDER_MUTATIONS, "exit code 2"}
    for key in wanted:
        held = (own.get(key) or planar[key])[1]
        named = set(re.findall(r"`([^`]+)`", held))
        # The plane's words for a goal's heading and curve mean nothing in space, its other checks do.
        assert held.startswith("none: ") or (named & known if key in planar else named <= known), key


def test_every_check_in_space_has_a_row_and_a_mutation() -> None:
    """Whatever the verifier in space checks has a motion that it alone catches, and its row."""
    checks = {general(each.name) for plan in SPACE_UNHARMED for each in plan().checks()}
    assert checks <= set(SPACE_MUTATIONS)
    assert set(SPACE_MUTATIONS) <= {*MUTATIONS, *rows("Checks in space")}


@pytest.mark.parametrize("number", range(len(SPACE_UNHARMED)))
def test_a_motion_in_space_that_keeps_everything_passes(number: int) -> None:
    """What the mutations in space begin with is refused by no check."""
    assert not SPACE_UNHARMED[number]().failed()


@pytest.mark.planning
@pytest.mark.parametrize("name", SPACE_MUTATIONS)
def test_a_broken_promise_in_space_is_caught_by_its_check_alone(name: str) -> None:
    """The check fails, and no other does: without it the motion would pass."""
    for mutation in SPACE_MUTATIONS[name]:
        assert list(map(general, mutation().failed())) == [name]


def test_every_array_has_a_row() -> None:
    """So has every array of ``solution.npz``."""
    own = {*FEED_SHAPES, *AXES_SHAPES, *DRIVE_ARRAYS, TOOL_TIP}
    assert set(rows("Arrays")) == {*SHAPES, *CLEARANCE_SHAPES, *own}


@pytest.mark.drawn(20, of="dear tests")
def test_every_key_of_the_record_has_a_row(written: Folder, written_in_space: Folder) -> None:
    """So has every key of ``solution.json``, in the plane and in space, and every file of text."""
    listed = set(rows("Record and files"))
    sometimes = {"tries", "tolerance", "goal_pose", "diagnosis", "room", "tour"}
    assert set(written.record) | set(written_in_space.record) | sometimes | set(NAMES) == listed


def test_every_check_has_a_row_and_a_mutation() -> None:
    """The checks of the page are those that have a mutation, and every row of a promise names some of them or none."""
    checks = set(rows("Checks, and what each alone catches"))
    assert checks == {*MUTATIONS, *FOLDER_MUTATIONS}
    for heading in ("Keys of the problem file", "Arrays", "Record and files"):
        for name, cells in rows(heading).items():
            named = set(re.findall(r"`([^`]+)`", cells[1]))
            nothing = cells[1].startswith("none: ")
            assert nothing or (named and named <= checks | {*SPACE_MUTATIONS, "exit code 2"}), name


@pytest.mark.parametrize("number", range(len(UNHARMED)))
def test_a_motion_that_keeps_everything_passes(number: int) -> None:
    """What the mutations begin with is refused by no check."""
    assert not UNHARMED[number]().failing


@pytest.mark.planning
@pytest.mark.parametrize(("name", "mutation"), [*MUTATIONS.items(), *TOOL_MUTATIONS.items()])
def test_a_broken_promise_of_the_motion_is_caught_by_its_check_alone(name: str, mutation: Mutation) -> None:
    """The check fails, and no other does: without it the motion would pass."""
    assert set(map(general, mutation().failing)) == {name}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """A plan as it was written."""
    return write_plans(tmp_path_factory.mktemp("plans"), ("smooth",))["smooth"]


@pytest.fixture(scope="module")
def written_in_space(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """A plan of a fed arm in space past a mesh, likewise."""
    return write_plans(tmp_path_factory.mktemp("plans"), ("fed in space",))["fed in space"]


@pytest.mark.parametrize(
    "path", ["goal.roll", "goal.position_error", "meshes.0.closed", "meshes.0.triangles", "meshes"]
)
def test_so_is_what_the_record_says_of_goal_and_meshes_in_space(
    written_in_space: Folder, tmp_path: Path, capsys: pytest.CaptureFixture[str], path: str
) -> None:
    """What records in space have of their own contradicts nothing either."""
    folder = written_in_space.copy()
    place: Any = folder.record
    *way, last = path.split(".")
    for key in way:
        place = place[int(key) if key.isdigit() else key]
    place[last] = 1.0
    folder.write(tmp_path / "plan")
    assert checking.check_folders([tmp_path / "plan"]) == NO_PLAN
    assert "Record against motion" in capsys.readouterr().out


@pytest.mark.drawn(8)
@pytest.mark.parametrize("name", FOLDER_MUTATIONS)
def test_what_contradicts_the_motion_is_caught_by_its_check_alone(
    written: Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """Whatever else a folder says is held against the motion, each thing by a check of its own."""
    said: list[Any] = []
    monkeypatch.setattr(checking, "print_result", lambda _, code, data: (said.append(data()), code)[1])
    for number, change in enumerate(FOLDER_MUTATIONS[name]):
        folder = written.copy()
        change(folder)
        folder.write(tmp_path / str(number))
        checking.check_folders([tmp_path / str(number)])
        assert {check["name"] for check in said[-1]["checks"] if not check["passed"]} == {name}, number
