"""Problem files to begin with: the commented one solves as it is, those of the package are listed and copied."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from ccm_opt.cli.commands import app
from ccm_opt.io.reading import load_problem

from .conftest import PROBLEMS


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and everything printed."""
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return done.exit_code, done.output


@pytest.mark.drawn(6, of="whole plans")
@pytest.mark.parametrize("options", [(), ("--space",)])
def test_the_new_problem_solves_as_it_is(options: tuple[str, ...], tmp_path: Path) -> None:
    """It is named after its file, with or without the ending, and its motion passes the verifier."""
    assert run("new", *options, tmp_path / "mine")[0] == 0
    file = tmp_path / "mine.toml"
    assert load_problem(file).name == "mine"
    assert run("solve", file, "--out", tmp_path / "runs", "--no-pictures")[0] == 0
    assert run("check", tmp_path / "runs" / "mine")[0] == 0


def test_nothing_of_the_users_is_replaced(tmp_path: Path) -> None:
    """A file that is there stays as it is, whether a new one or a copy would take its place."""
    for name, command in (("mine", ("new", tmp_path / "mine")), ("fork", ("problems", "fork", "--out", tmp_path))):
        file = tmp_path / f"{name}.toml"
        file.write_text("of mine")
        code, said = run(*command)
        assert (code, "exists and is not overwritten" in said) == (2, True)
        assert file.read_text() == "of mine"


@pytest.mark.parametrize("name", ["a?b", "con", "x" * 201])
def test_names_that_are_no_folders_are_refused(name: str, tmp_path: Path) -> None:
    """They would name an output folder; nothing is written."""
    code, said = run("new", tmp_path / name)
    assert (code, "expected a name that can be a folder's" in said) == (2, True)
    assert not list(tmp_path.iterdir())


def test_the_problems_of_the_package_are_listed_and_copied(tmp_path: Path) -> None:
    """Every one has a description, copies are the files themselves, and an unknown name does not keep the others."""
    listed = json.loads(run("problems", "--json")[1])["results"][0]["problems"]
    # Problems in space go by their folder, too: some have the names of problems in the plane.
    spatial = {f"space/{file.stem}" for file in (PROBLEMS / "space").glob("*.toml")}
    planar = {file.stem for file in PROBLEMS.rglob("*.toml") if file.parent.name != "space"}
    assert set(listed) == planar | spatial
    assert all(listed.values())
    code, said = run("problems", "fork", "nothing", "swan-neck", "--out", tmp_path / "new")
    assert (code, "there is no problem 'nothing'" in said) == (2, True)
    for name in ("fork", "swan-neck"):
        assert (tmp_path / "new" / f"{name}.toml").read_text() == (PROBLEMS / f"{name}.toml").read_text()


def test_names_that_are_listed_stand_for_their_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Where the user has no file of that name, the problem that comes along is taken."""
    monkeypatch.chdir(tmp_path)
    code, said = run("describe", "space/wing-box", "hot-cell")
    assert code == 0
    assert "hot-cell: 30 links" in said
    assert "no such file" in run("describe", "hotcell")[1]


def test_copies_that_meet_are_refused_before_anything_of_them_is_written(tmp_path: Path) -> None:
    """Two problems of one file name, and a file in the way, leave no mesh or drawing behind."""
    code, said = run("problems", "wing-box", "space/wing-box", "--out", tmp_path)
    assert (code, "was just written for 'wing-box'" in said) == (2, True)
    before = sorted(tmp_path.rglob("*"))
    assert run("problems", "space/wing-box", "--out", tmp_path)[0] == 2
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("command", ["solve", "pose", "reach", "view", "problems"])
def test_paths_that_are_too_long_are_bad_input(command: str, tmp_path: Path) -> None:
    """In the place of a file or of an output folder they are told in a line."""
    far = tmp_path / ("a" * 300)
    given = [far] if command == "view" else ["fork", "--out", far]
    code, said = run(command, *given)
    assert (code, "too long" in " ".join(said.split())) == (2, True)
    assert "Traceback" not in said
