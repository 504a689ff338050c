"""Text files of a folder may have been written anew by an export, and still say what the arrays say."""

from pathlib import Path

import pytest

from ccm_opt.cli.outcome import NO_PLAN, SOLVED
from ccm_opt.cli.written_plans import check_folders
from ccm_opt.io.controller_points import controller_points, trajectory_texts
from ccm_opt.io.folder import model_texts
from ccm_opt.io.text_agreement import text_checks

from .corruption.plans import Folder, write_plans


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Folder:
    """A plan as it was written."""
    return write_plans(tmp_path_factory.mktemp("plans"), ("fed",))["fed"]


def test_what_export_writes_in_place_of_a_file_is_accepted(written: Folder, tmp_path: Path) -> None:
    """Bends alone, and descriptions without obstacles, say less and nothing else."""
    folder = written.copy()
    solution = folder.solution
    points = controller_points(solution.problem, solution.trajectory, solution.joints, solution.checks)
    texts = trajectory_texts(points, bends_only=True, effort=True)
    folder.texts |= dict(zip(("trajectory.csv", "trajectory.yaml"), texts, strict=True))
    folder.texts |= model_texts(solution.problem, obstacles=False, bends_only=True)
    folder.write(tmp_path / "bends")
    assert check_folders([tmp_path / "bends"]) == SOLVED


def test_what_is_left_of_zero_may_differ(written: Folder, tmp_path: Path) -> None:
    """Angles of a description that would be zero but for rounding are those of the problem, larger ones are not."""
    folder = written.copy()
    text = folder.texts["arm.urdf"]
    assert 'rpy="0.0 0.0 0.0"' in text
    for number, outcome in (("2e-16", SOLVED), ("2e-12", NO_PLAN)):
        folder.texts["arm.urdf"] = text.replace('rpy="0.0 0.0 0.0"', f'rpy="0.0 {number} 0.0"', 1)
        folder.write(tmp_path / number)
        assert check_folders([tmp_path / number]) == outcome


@pytest.mark.drawn(2)
@pytest.mark.parametrize("text", ["", "nonsense", "\x00", "<robot/>", "time\n1\n2", "joint_names: []\npoints:"])
def test_what_is_nothing_of_the_kind_is_refused(written: Folder, tmp_path: Path, text: str) -> None:
    """With a reason, and never with a traceback."""
    for name in sorted(written.texts):
        folder = written.copy()
        folder.texts[name] = text
        folder.write(tmp_path / name)
        assert check_folders([tmp_path / name]) == NO_PLAN


def test_declarations_are_not_expanded(written: Folder, tmp_path: Path) -> None:
    """A description with entities is refused unread."""
    folder = written.copy()
    bomb = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><robot name="&b;"/>'
    folder.texts["arm.urdf"] = bomb
    folder.write(tmp_path / "bomb")
    assert check_folders([tmp_path / "bomb"]) == NO_PLAN


@pytest.mark.parametrize("name", ["trajectory.csv", "trajectory.yaml"])
def test_table_and_message_are_held_against_the_arrays_each_for_itself(
    written: Folder, tmp_path: Path, name: str
) -> None:
    """One number less in one row and one more in the next are not made up for by the other file, which is right."""
    folder = written.copy()
    lines = folder.texts[name].splitlines()
    rows = [k for k, line in enumerate(lines) if line.count(",") > 3 and "joint" not in line and "time" not in line]
    first, second = (rows[0], rows[2] if name.endswith("yaml") else rows[1])
    shorter, _, last = lines[first].rstrip("]").rpartition(",")
    ending = "]" if name.endswith("yaml") else ""
    lines[first] = shorter + ending
    lines[second] = f"{lines[second].rstrip(']')},{last}{ending}"
    folder.texts[name] = "\n".join(lines) + "\n"
    folder.write(tmp_path / name)
    assert check_folders([tmp_path / name]) == NO_PLAN


@pytest.mark.parametrize("number", ["inf", "-1e999", "nan"])
def test_numbers_that_are_infinite_or_none_are_refused(written: Folder, tmp_path: Path, number: str) -> None:
    """Nothing is within a share of what has no size; each file has one number of some row changed."""
    folder = written.copy()
    for name in ("trajectory.csv", "trajectory.yaml"):
        head, comma, tail = folder.texts[name].rpartition(",")
        end = "]\n" if tail.rstrip().endswith("]") else "\n"
        folder.texts[name] = f"{head}{comma}{number}{end}"
    folder.write(tmp_path / "infinite")
    solution = folder.solution
    motion = (solution.trajectory, solution.joints, solution.checks)
    checks = text_checks(tmp_path / "infinite", solution.problem, *motion)
    refused = {check.name for check in checks if not check.passed}
    assert refused == {"table against arrays", "ROS message against arrays"}


def test_rows_without_numbers_are_refused(written: Folder, tmp_path: Path) -> None:
    """A table of times alone is told of in a line, also where warnings are errors."""
    folder = written.copy()
    head, *rows = folder.texts["trajectory.csv"].splitlines()
    folder.texts["trajectory.csv"] = "\n".join([head, *(row.partition(",")[0] for row in rows)])
    folder.write(tmp_path / "times")
    assert check_folders([tmp_path / "times"]) == NO_PLAN
