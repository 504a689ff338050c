"""Inputs have bounds: problem files, drawings outside the folder, archives of arrays, text on pages, modules."""

import io
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from ccm_opt.core.errors import ProblemError, ProblemFileError
from ccm_opt.io.folder import write_solution
from ccm_opt.io.reading import BOUNDS, load_problem, parse_problem
from ccm_opt.io.reading_back import load_motion
from ccm_opt.problem.solution import Solution

from .conftest import SMALL_PROBLEM
from .test_cli_output import run


def with_keys(count: int) -> str:
    """The small problem with so many keys that nobody knows."""
    return SMALL_PROBLEM.replace("[arm]\n", "[arm]\n" + "".join(f"key{k} = 1\n" for k in range(count)))


def corners(count: int) -> str:
    """The corners of a polygon as text."""
    return ", ".join(f"[{k}, 0]" for k in range(count))


def test_a_hundred_defects_are_listed_and_the_rest_counted() -> None:
    """Of 5000 unknown keys the first hundred stand there with their lines, and 4900 more are told of."""
    with pytest.raises(ProblemFileError) as caught:
        parse_problem(with_keys(5000))
    lines = str(caught.value).splitlines()
    assert "has 5000 errors" in lines[0]
    assert lines[-1] == "  and 4900 more"
    assert len(lines) == 102
    assert [issue.key for issue in caught.value.issues] == [f"arm.key{k}" for k in range(100)]


@pytest.mark.drawn(4)
@pytest.mark.planning
@pytest.mark.parametrize(
    ("text", "message"),
    [
        (with_keys(100_000), f"more than {BOUNDS.most_keys} keys"),
        ("a = " + "[" * 500_000, "nested too deeply"),
        ("a = " + "[" * 100 + "]" * 100, "nested more than 20 deep"),
        (".".join(["a"] * 100_000) + " = 1", "a key has 100000 parts"),
        (".".join(["a"] * 30) + " = 1", "nested more than 20 deep"),
        (SMALL_PROBLEM + f"\n[[workspace.obstacles]]\npolygon = [{corners(100_001)}]", "a list has 100001 entries"),
        (
            SMALL_PROBLEM + f"\n[[workspace.obstacles]]\npolygon = [{corners(70_000)}]" * 3,
            "more than 200000 points, the most that can be read",
        ),
    ],
)
def test_what_is_too_large_is_refused_with_the_bound(text: str, message: str) -> None:
    """One sentence with the bound, and soon: the time is linear in the size of the file."""
    began = time.process_time()
    with pytest.raises(ProblemFileError, match=message) as caught:
        parse_problem(text)
    assert len(caught.value.issues) == 1
    assert time.process_time() - began < 20.0  # an order above what is measured


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_a_hundred_thousand_unknown_keys_take_no_longer_than_their_number() -> None:
    """Ten times as many unknown keys take far less than a hundred times as long."""
    spent = []
    for count in (2_000, 20_000):
        began = time.process_time()
        with pytest.raises(ProblemFileError):
            parse_problem(with_keys(count))
        spent.append(time.process_time() - began)
    assert spent[1] < 50.0 * spent[0]


def test_large_files_and_devices_without_an_end_are_refused(tmp_path: Path) -> None:
    """No more is read than is allowed."""
    path = tmp_path / "large.toml"
    path.write_bytes(b"#" * (BOUNDS.most_bytes + 1))
    with pytest.raises(ProblemFileError, match=f"more than {BOUNDS.most_bytes} bytes"):
        load_problem(path)
    if Path("/dev/zero").exists():
        with pytest.raises(ProblemFileError, match=f"more than {BOUNDS.most_bytes} bytes"):
            load_problem("/dev/zero")


@pytest.fixture
def inner(tmp_path: Path) -> Path:
    """A folder beside a drawing."""
    (tmp_path / "scene.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><circle cx=".5" cy=".5" r=".1"/></svg>'
    )
    (tmp_path / "inner").mkdir()
    return tmp_path / "inner"


def names_drawing(folder: Path, name: str) -> Path:
    """The small problem with a drawing."""
    path = folder / "problem.toml"
    path.write_text(SMALL_PROBLEM.replace("[workspace]\n", f'[workspace]\nfile = "{name}"\n'))
    return path


@pytest.mark.parametrize("way", ["../scene.svg", "absolute", "link"])
def test_drawings_outside_the_folder_need_leave(inner: Path, way: str) -> None:
    """By dots, by a whole path, or by a link: refused unless allowed, in Python and on the command line."""
    name = way
    if way == "absolute":
        name = str(inner.parent / "scene.svg")
    elif way == "link":
        (inner / "link").symlink_to(inner.parent / "scene.svg")
        (inner / "link.svg").symlink_to(inner.parent / "scene.svg")
        name = "link.svg"
    path = names_drawing(inner, name)
    with pytest.raises(ProblemFileError, match="outside the folder of the problem file"):
        load_problem(path)
    assert len(load_problem(path, allow_outside=True).workspace.obstacles) == 2
    assert run("describe", path).exit_code == 2
    assert "--allow-outside" in run("describe", path).stderr
    assert run("describe", path, "--allow-outside").exit_code == 0


def test_drawings_in_folders_of_the_folder_need_none(inner: Path) -> None:
    """What lies below the problem file is part of it."""
    assert len(load_problem(names_drawing(inner.parent, "inner/../scene.svg")).workspace.obstacles) == 2


def test_messages_do_not_quote_what_is_no_drawing(tmp_path: Path) -> None:
    """A file that is no WKT may be somebody's secret: no more than its first word is told."""
    (tmp_path / "secret.wkt").write_text("password: swordfish and more of it")
    with pytest.raises(ProblemFileError) as caught:
        load_problem(names_drawing(tmp_path, "secret.wkt"))
    assert "swordfish" not in str(caught.value).lower()


@pytest.fixture
def folder(small_solution: Solution, tmp_path: Path) -> Path:
    """The folder of a made-up plan."""
    return write_solution(small_solution, tmp_path / "runs")


def rewritten(folder: Path, name: str, array: np.ndarray) -> None:
    """Put an array into a plan's archive, in the place of the one of its name."""
    with np.load(folder / "solution.npz") as archive:
        arrays = {**{key: archive[key] for key in archive.files}, name: array}
    np.savez(folder / "solution.npz", **arrays)  # type: ignore[arg-type]


def test_unexpected_members_are_refused_unread(folder: Path, small_solution: Solution) -> None:
    """An array of another name stops the reading before anything is unpacked."""
    rewritten(folder, "extra", np.zeros(3))
    with pytest.raises(ProblemError, match=r"contains 'extra\.npy', which is not an array"):
        load_motion(folder, small_solution.problem.arm)


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_archives_that_would_fill_the_memory_are_refused_unread(folder: Path, small_solution: Solution) -> None:
    """A gigabyte of zeros in five megabytes: refused by their size, unpacked never."""
    with zipfile.ZipFile(folder / "solution.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (2**27,)})
    with zipfile.ZipFile(folder / "solution.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in members.items():
            if name != "time.npy":
                archive.writestr(name, content)
        with archive.open("time.npy", "w", force_zip64=True) as bomb:
            bomb.write(header.getvalue())
            for _ in range(1024):
                bomb.write(bytes(2**20))
    assert (folder / "solution.npz").stat().st_size < 6 * 2**20
    with pytest.raises(ProblemError, match=r"its arrays take 10\d+ bytes unpacked"):
        load_motion(folder, small_solution.problem.arm)


@pytest.mark.parametrize("stops", [[251.0], [-1.0], [0.5], [1e300]])
def test_stops_out_of_range_are_refused(folder: Path, small_solution: Solution, stops: list[float]) -> None:
    """A stop is the number of a sample."""
    rewritten(folder, "stops", np.array(stops))
    with pytest.raises(ProblemError, match="the array 'stops' contains something"):
        load_motion(folder, small_solution.problem.arm)


def test_the_working_directory_does_not_stand_in_for_the_standard_library(tmp_path: Path) -> None:
    """A file beside the user that is called like a module of Python is never loaded in its place."""
    (tmp_path / "csv.py").write_text("raise SystemExit('the wrong csv')")
    (tmp_path / "mine.py").write_text(
        "import ccm_opt\nhigh = ccm_opt.Constraint('high', lambda q: q.tip[1], lower=-9.0)\n"
    )
    code = (
        "import sys; sys.path = [p for p in sys.path if p not in ('', sys.argv[1])]\n"
        "from ccm_opt.ik.terms import _module\n"
        "assert _module('mine:high', 'mine').high.name == 'high'\n"
        "import csv; assert 'DictReader' in dir(csv)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
