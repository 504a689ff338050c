"""The output folder: complete, strict, replaced whole or not at all, and read back with distrust."""

import csv
import json
import os
import shutil
import tomllib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ccm_opt.cli.written_plans import check_folders
from ccm_opt.core.errors import Diagnosis, ProblemError, VerificationError
from ccm_opt.io import folder as folder_module
from ccm_opt.io.folder import check_target, solution_files, write_folder, write_solution
from ccm_opt.io.reading import problem_from_mapping
from ccm_opt.io.reading_back import SHAPES, load_motion, load_problem_data
from ccm_opt.io.result_folders import FAILED, UNFINISHED, sibling_folder, write_failure
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.problem.solution import Solution

FILES = {"solution.json", "solution.npz", "trajectory.csv", "trajectory.yaml", "arm.urdf", "arm.mjcf.xml"}


def refuse_constant(name: str) -> None:
    """Fail on the constants that are not JSON."""
    raise AssertionError(f"{name} is not JSON")


@pytest.fixture
def written(small_solution: Solution, tmp_path: Path) -> Path:
    """The folder of a made-up plan."""
    return write_solution(small_solution, tmp_path / "runs", {"plan.png": b"picture"})


def test_the_folder_has_every_file_and_nothing_beside_it(written: Path) -> None:
    """Exactly the files of the format are there, and no working folder is left."""
    assert {path.name for path in written.iterdir()} == FILES | {"plan.png"}
    assert [path.name for path in written.parent.iterdir()] == ["small"]


def test_the_record_is_strict_json_with_every_key(written: Path) -> None:
    """``solution.json`` has the keys of the format; NaN and infinity stand as null."""
    record = json.loads((written / "solution.json").read_text(), parse_constant=refuse_constant)
    asked = {"schema", "status", "method", "problem", "versions", "seed"}
    assert set(record) == asked | {"metrics", "timings", "timed_by", "checks", "not_checked", "simulation"}
    assert (record["schema"], record["status"], record["method"], record["seed"]) == (1, "solved", "nlp", 0)
    assert record["metrics"] == {"duration": 1.0, "tip_error": None}
    assert record["checks"][1] == {
        "name": "wall clearance",
        "worst": None,
        "limit": 0.0,
        "unit": "m",
        "where": "link 3, post",
        "passed": True,
    }


def test_the_copy_of_the_problem_rebuilds_it(written: Path, small_problem: Problem) -> None:
    """The record alone gives the same problem."""
    again = problem_from_mapping(load_problem_data(written))
    assert again.workspace.obstacles[0].name == "post"
    assert again.arm.length == small_problem.arm.length
    np.testing.assert_array_equal(again.limits.velocity, small_problem.limits.velocity)


def test_the_arrays_have_the_names_and_shapes_of_the_format(written: Path, small_solution: Solution) -> None:
    """``solution.npz`` holds every array, and the motion read from it is the motion written."""
    with np.load(written / "solution.npz", allow_pickle=False) as arrays:
        assert set(arrays.files) == set(SHAPES)
        assert arrays["joint_positions"].shape == (251, 5, 2)
        assert arrays["segments_offsets"].tolist() == [0, 2, 4, 6]
        assert arrays["segment_curvatures"].shape == (6, 5)
    motion = load_motion(written, small_solution.problem.arm)
    assert motion.joints.names == small_solution.joints.names
    for name in ("time", "bend_angles", "bend_velocities", "bend_accelerations"):
        np.testing.assert_array_equal(getattr(motion.trajectory, name), getattr(small_solution.trajectory, name))
    for name in ("angles", "velocities", "accelerations", "torques"):
        np.testing.assert_array_equal(getattr(motion.joints, name), getattr(small_solution.joints, name))


def test_the_table_names_every_column_and_holds_samples(written: Path, small_solution: Solution) -> None:
    """``trajectory.csv`` gives angle, velocity, acceleration and torque of every joint by name."""
    with (written / "trajectory.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    joints = small_solution.joints
    assert len(rows) < 25
    assert list(rows[0]) == ["time"] + [
        f"{name}_{what}" for what in ("angle", "velocity", "acceleration", "torque") for name in joints.names
    ]
    samples = np.searchsorted(small_solution.trajectory.time, [float(row["time"]) - 1e-6 for row in rows])
    assert samples[[0, -1]].tolist() == [0, 250]
    column = [float(row[f"{joints.names[1]}_velocity"]) for row in rows]
    np.testing.assert_allclose(column, joints.velocities[samples, 1], rtol=1e-11, atol=1e-15)


def test_the_ros_message_is_as_its_type_says(written: Path, small_solution: Solution) -> None:
    """``trajectory.yaml`` has the joint names, and points whose lists are flow sequences of numbers."""
    lines = (written / "trajectory.yaml").read_text().splitlines()
    assert json.loads(lines[0].removeprefix("joint_names: ")) == list(small_solution.joints.names)
    assert lines[1] == "points:"
    assert lines[-3] == "- time_from_start: {sec: 1, nanosec: 0}"
    assert [line.split(":")[0].strip() for line in lines[-2:]] == ["positions", "velocities"]
    np.testing.assert_allclose(json.loads(lines[-2].split(":")[1]), small_solution.joints.angles[-1], rtol=1e-11)


def test_a_failure_leaves_its_record_beside_an_earlier_plan(
    small_problem: Problem, tmp_path: Path, written: Path
) -> None:
    """A failed run leaves the plan of the run before to the last byte, and its own status and diagnosis beside it."""
    before = {path.name: path.read_bytes() for path in written.iterdir()}
    diagnosis = Diagnosis("no way round 'post'", "routes", ("move it",), {"gap": np.float64(0.01)})
    target = write_failure(small_problem, "timed-out", diagnosis, tmp_path / "runs")
    assert {path.name: path.read_bytes() for path in written.iterdir()} == before
    assert target == written.with_name("small.failed")
    assert [path.name for path in target.iterdir()] == ["solution.json"]
    record = json.loads((target / "solution.json").read_text())
    assert record["status"] == "timed-out"
    assert record["diagnosis"] == {
        "reason": "no way round 'post'",
        "stage": "routes",
        "advice": ["move it"],
        "evidence": {"gap": 0.01},
        "findings": [],
        "relaxations": [],
        "failed_changes": [],
    }
    with pytest.raises(VerificationError, match="timed-out'; no way round"):
        load_problem_data(target)


def test_a_failure_replaces_the_record_of_an_earlier_one(small_problem: Problem, tmp_path: Path) -> None:
    """Without a plan there is one record, in the folder's own place, whose newest content counts."""
    for reason in ("first", "second"):
        target = write_failure(small_problem, "timed-out", Diagnosis(reason, "routes"), tmp_path)
        assert target == tmp_path / "small"
        assert json.loads((target / "solution.json").read_text())["diagnosis"]["reason"] == reason
    assert [path.name for path in tmp_path.iterdir()] == ["small"]


def test_nothing_beside_an_earlier_plan_is_replaced(written: Path, small_solution: Solution) -> None:
    """Plans that were cut short are numbered, and a folder of the user that has the name of the next one is passed."""
    places = [sibling_folder(written, UNFINISHED)]
    write_folder(places[0], solution_files(small_solution))
    written.with_name("small.unfinished-2").mkdir()
    places.append(sibling_folder(written, UNFINISHED))
    written.with_name("small.failed").write_text("mine")
    places.append(sibling_folder(written, FAILED))
    assert [place.name for place in places] == ["small.unfinished", "small.unfinished-3", "small.failed-2"]


def test_files_of_the_user_stay(written: Path, small_solution: Solution) -> None:
    """Writing again replaces our files and keeps what the user put beside them."""
    (written / "notes.txt").write_text("mine")
    (written / "more").mkdir()
    (written / "more" / "file").write_text("mine too")
    write_solution(small_solution, written.parent)
    assert {path.name for path in written.iterdir()} == FILES | {"notes.txt", "more"}
    assert (written / "more" / "file").read_text() == "mine too"


def test_a_folder_of_something_else_is_not_touched(small_solution: Solution, tmp_path: Path) -> None:
    """A folder without our record is refused, and left as it is."""
    (tmp_path / "small").mkdir()
    (tmp_path / "small" / "thesis.tex").write_text("years")
    with pytest.raises(ProblemError, match="the folder holds other files"):
        write_solution(small_solution, tmp_path)
    assert [path.name for path in (tmp_path / "small").iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("step", ["mkdir", "open"])
def test_a_failing_disk_leaves_the_old_folder(
    written: Path, small_solution: Solution, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    """When writing fails half-way, the old folder is whole and nothing else remains."""
    before = {path.name: path.read_bytes() for path in written.iterdir()}
    original: Callable[..., object] = getattr(Path, step)

    def failing(self: Path, *arguments: object, **options: object) -> object:
        if self.name in {"new", "trajectory.yaml"}:
            raise OSError(28, "No space left on device")
        return original(self, *arguments, **options)

    monkeypatch.setattr(Path, step, failing)
    with pytest.raises(ProblemError, match="No space left"):
        write_solution(small_solution, written.parent)
    monkeypatch.undo()
    assert {path.name: path.read_bytes() for path in written.iterdir()} == before
    assert [path.name for path in written.parent.iterdir()] == ["small"]


def test_places_that_cannot_be_written_are_refused_beforehand(tmp_path: Path) -> None:
    """A file in the way is noticed before any work, and the message names it."""
    (tmp_path / "file").write_text("")
    with pytest.raises(ProblemError, match="not a writable folder"):
        check_target(tmp_path / "file" / "small")
    with pytest.raises(ProblemError, match="not a folder"):
        check_target(tmp_path / "file")
    check_target(tmp_path / "new" / "deeper" / "small")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_read_only_directory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the right to write, the message says so."""
    monkeypatch.setattr(os, "access", lambda path, mode: Path(path) != tmp_path or not mode & os.W_OK)
    with pytest.raises(ProblemError, match="not a writable folder"):
        check_target(tmp_path / "small")


def test_new_files_have_usual_permissions(written: Path) -> None:
    """The folder can be read by others as far as the user's mask allows."""
    mask = os.umask(0)
    os.umask(mask)
    assert written.stat().st_mode & 0o777 == 0o777 & ~mask


def test_the_copy_is_of_the_problem_that_was_solved(small_solution: Solution, tmp_path: Path) -> None:
    """After ``dataclasses.replace`` and without any source text, the record has the new values, not the file's."""
    moved = replace(small_solution.problem, goal=TipGoal(np.array([0.25, 0.15]), heading=0.5))
    for problem in (moved, replace(moved, source=""), replace(moved, source="not TOML")):
        folder = write_solution(replace(small_solution, problem=problem), tmp_path)
        goal = problem_from_mapping(load_problem_data(folder)).goal
        assert isinstance(goal, TipGoal)
        np.testing.assert_allclose(goal.position, [0.25, 0.15], rtol=1e-12)
        assert goal.heading == pytest.approx(0.5, rel=1e-12)


def test_the_copy_is_the_file_as_long_as_it_holds(written: Path, small_text: str) -> None:
    """A problem that was not changed is recorded in the user's own words."""
    assert load_problem_data(written) == tomllib.loads(small_text)


def test_a_changed_problem_is_checked_as_changed(
    small_solution: Solution, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``check`` measures the distance to the goal that was set by ``replace``, and it holds."""
    arm, end = small_solution.problem.arm, small_solution.trajectory.bend_angles[-1]
    tip = arm.joint_positions(arm.headings(end))[-1]
    problem = replace(small_solution.problem, goal=TipGoal(tip))
    folder = write_solution(replace(small_solution, problem=problem), tmp_path)
    check_folders([folder])
    rows = [line for line in capsys.readouterr().out.splitlines() if "Tip error at the goal" in line]
    assert len(rows) == 1
    assert "fails" not in rows[0]


@pytest.mark.parametrize("schema", [9, 0, "1", None])
def test_records_of_unknown_schemas_are_refused(written: Path, schema: object) -> None:
    """A record in another layout is bad input: it is not read as if it were this one."""
    path = written / "solution.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": schema}))
    with pytest.raises(ProblemError, match=f"schema is {schema!r}; this version reads schema 1"):
        load_problem_data(written)


def test_a_file_is_no_folder(written: Path) -> None:
    """Naming ``solution.json`` itself instead of its folder is explained."""
    with pytest.raises(ProblemError, match=r"solution\.json: this is not a folder"):
        load_problem_data(written / "solution.json")


def tamper(path: Path, change: Callable[[dict[str, np.ndarray]], object]) -> None:
    """Change the arrays of an archive in place."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    change(arrays)
    np.savez(path, **arrays)


TAMPERINGS: dict[str, tuple[Callable[[dict[str, np.ndarray]], object], str]] = {
    "missing": (lambda a: a.pop("joint_torques"), "'joint_torques' is missing"),
    "fewer samples": (lambda a: a.update(time=a["time"][:-1]), "'bend_angles' has shape"),
    "flat": (lambda a: a.update(bend_angles=a["bend_angles"].ravel()), "'bend_angles' has shape"),
    "another arm": (lambda a: a.update(keyframes=a["keyframes"][:, :2]), "'keyframes' has shape"),
    "not finite": (lambda a: a["joint_angles"].__setitem__((3, 1), np.nan), "not a finite number"),
    "text": (lambda a: a.update(time=a["time"].astype(str)), "not a finite number"),
    "names": (lambda a: a.update(joint_names=a["joint_names"][::-1]), "joint_names differ from those"),
    "bends": (lambda a: a["bend_angles"].__setitem__((9, 1), 0.5), "joint_positions differ from bend_angles by up to"),
    "one sample": (
        lambda a: a.update({k: v[:1] for k, v in a.items() if SHAPES[k][0] == "samples"}),
        "at least two samples",
    ),
}


@pytest.mark.parametrize("name", TAMPERINGS)
def test_malformed_arrays_are_refused(written: Path, small_problem: Problem, name: str) -> None:
    """Arrays that are missing, misshapen, not finite or contradictory are refused with the array's name."""
    change, message = TAMPERINGS[name]
    tamper(written / "solution.npz", change)
    with pytest.raises(ProblemError, match=message):
        load_motion(written, small_problem.arm)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 torn", b"\x93NUMPY\x01\x00"])
def test_files_that_are_no_archives_are_refused(written: Path, small_problem: Problem, content: bytes) -> None:
    """Rubbish instead of ``solution.npz`` is a clear message."""
    (written / "solution.npz").write_bytes(content)
    with pytest.raises(ProblemError, match="not readable as arrays"):
        load_motion(written, small_problem.arm)


def test_pickles_are_never_loaded(written: Path, small_problem: Problem) -> None:
    """An array of objects, which would run code when loaded, is refused."""
    tamper(written / "solution.npz", lambda arrays: arrays.update(time=np.array([{}], dtype=object)))
    with pytest.raises(ProblemError, match="not readable as arrays"):
        load_motion(written, small_problem.arm)


@pytest.mark.parametrize(
    "content", [b"", b"[1, 2]", b"{", b"\xff\xfe", b'{"schema": 1, "status": "solved", "problem": 3}']
)
def test_malformed_records_are_refused(written: Path, content: bytes) -> None:
    """Rubbish instead of ``solution.json`` is a clear message."""
    (written / "solution.json").write_bytes(content)
    with pytest.raises(ProblemError, match=r"solution\.json"):
        load_problem_data(written)


def test_missing_files_are_named(written: Path, small_problem: Problem) -> None:
    """A folder that lost its files is refused with the file's name."""
    (written / "solution.npz").unlink()
    with pytest.raises(ProblemError, match=r"solution\.npz: there is no such file"):
        load_motion(written, small_problem.arm)
    shutil.rmtree(written)
    with pytest.raises(ProblemError, match=r"solution\.json: there is no such file"):
        load_problem_data(written)


def test_own_files_cover_what_is_written(written: Path) -> None:
    """Every file that a run writes is known as ours, so that the next run replaces it."""
    assert {path.name for path in written.iterdir()} <= folder_module.WRITTEN_FILES


def test_an_empty_folder_may_be_filled(tmp_path: Path) -> None:
    """An empty folder in the place is no obstacle."""
    (tmp_path / "small").mkdir()
    write_folder(tmp_path / "small", {"solution.json": b"{}"})
    assert (tmp_path / "small" / "solution.json").read_bytes() == b"{}"
