"""The journal: whole lines, each run once, one writer at a time."""

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ccm_opt.cli.compare.runs import Run, json_line, open_journal
from ccm_opt.cli.comparing import compare_methods
from ccm_opt.core.errors import ProblemError

from .test_comparison import small_cases, wanted


def run(key: str = "a", **changes: object) -> Run:
    """A solved run."""
    values: dict[str, object] = {"outcome": "solved", "reason": "", "figures": {"duration_s": 1.5}, "wall": 0.25}
    return Run(key, "problem", "method", **{**values, **changes})  # type: ignore[arg-type]


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
@given(
    st.text(),
    st.dictionaries(st.text(max_size=5), st.floats(allow_nan=False, allow_infinity=False), max_size=4),
    st.floats(0.0, 1e6),
)
@settings(max_examples=50, deadline=None)
def test_a_run_comes_back_as_it_was(reason: str, figures: dict[str, float], wall: float) -> None:
    """A line is JSON without line breaks, and holds the whole run."""
    original = run(outcome="no plan", reason=reason, figures=figures, wall=wall)
    line = json_line(original)
    assert line.count(b"\n") == 1
    assert Run(**json.loads(line)) == original


def test_figures_that_are_not_finite_are_left_out() -> None:
    """JSON has no infinity; a figure that is missing reads as NaN."""
    read = Run(**json.loads(json_line(run(figures={"duration_s": math.inf, "cpu_s": 1.0}))))
    assert read.figures == {"cpu_s": 1.0}
    assert math.isnan(read.figure("duration_s"))


def test_runs_are_kept_and_found_again(tmp_path: Path) -> None:
    """What was appended is there when the journal is opened again; a key counts once, the first time."""
    path = tmp_path / "new" / "journal.jsonl"
    with open_journal(path) as journal:
        journal.append(run("a"))
        journal.append(run("b", wall=2.0))
        journal.append(run("a", wall=9.0))
    with open_journal(path) as journal:
        assert {key: item.wall for key, item in journal.runs.items()} == {"a": 0.25, "b": 2.0}
    assert len(path.read_text().splitlines()) == 2


def test_a_crash_gives_way_to_a_later_result(tmp_path: Path) -> None:
    """A crashed run does not count as done, and the run that takes its place does."""
    path = tmp_path / "journal.jsonl"
    with open_journal(path) as journal:
        journal.append(run("a", outcome="crashed"))
        assert not journal.has("a")
        journal.append(run("a"))
        assert journal.has("a")
    with open_journal(path) as journal:
        assert journal.runs["a"].solved


@pytest.mark.parametrize("kept", range(1, 40, 7))
def test_a_torn_line_is_cut_off(tmp_path: Path, kept: int) -> None:
    """After a process died in the middle of a line, the whole lines count and the next is written behind them."""
    path = tmp_path / "journal.jsonl"
    path.write_bytes(json_line(run("a")) + json_line(run("b"))[:kept])
    with open_journal(path) as journal:
        assert list(journal.runs) == ["a"]
        journal.append(run("c"))
    with open_journal(path) as journal:
        assert list(journal.runs) == ["a", "c"]


@pytest.mark.parametrize("line", ["{}", "[]", "no json", '{"key": "a", "surprise": 1}'])
def test_a_line_that_is_no_run_is_named(tmp_path: Path, line: str) -> None:
    """A file that holds something else is refused with the number of the line, and is not changed."""
    path = tmp_path / "journal.jsonl"
    content = json_line(run("a")).decode() + line + "\n"
    path.write_text(content)
    with pytest.raises(ProblemError, match="line 2 is not a run"), open_journal(path):
        pass
    assert path.read_text() == content


@pytest.mark.drawn(6, of="processes")
def test_two_writers_are_kept_apart(tmp_path: Path) -> None:
    """While one comparison writes, another one is refused; afterwards it is not."""
    path = tmp_path / "journal.jsonl"
    code = f"""
from pathlib import Path
from ccm_opt.cli.compare.runs import open_journal
with open_journal(Path({str(path)!r})):
    print("mine")
"""
    with open_journal(path):
        second = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "being written by another comparison" in second.stderr
    third = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert third.stdout == "mine\n"


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    """A folder in the place of the file gives one clear sentence."""
    with pytest.raises(ProblemError, match="cannot write"), open_journal(tmp_path):
        pass


def test_a_full_disk_leaves_a_whole_journal(tmp_path: Path) -> None:
    """A line for which there is no room is taken out again, and said; with room the same run is written, once."""
    resource = pytest.importorskip("resource")
    path = tmp_path / "journal.jsonl"
    first, second = (Run(key, "a", "nlp", "solved", figures={"cpu_s": 1.0}) for key in ("1", "2"))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with open_journal(path) as journal:
        journal.append(first)
        whole = path.read_bytes()
        # The system takes ten bytes more of any file of this process, and then refuses, as a full disk does.
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole) + 10, hard))
        try:
            for _ in range(2):
                with pytest.raises(ProblemError, match="the 1 runs before this one are in it"):
                    journal.append(second)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert path.read_bytes() == whole
        journal.append(second)
    with open_journal(path) as journal:
        assert sorted(journal.runs) == ["1", "2"]
    assert len(path.read_text().splitlines()) == 2


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device that is always full")
def test_a_comparison_on_a_full_disk_ends_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command ends with exit code 2 and one clear sentence, without a traceback."""
    small_cases(tmp_path, 1)
    out = tmp_path / "out"
    out.mkdir()
    (out / "journal.jsonl").symlink_to("/dev/full")
    assert compare_methods(**wanted(tmp_path)) == 2
    err = " ".join(capsys.readouterr().err.split())
    assert "No space left on device" in err
    assert "repeat the command to continue" in err
    assert "Traceback" not in err
