"""The examples of own constraints and costs run, end, and do what they say."""

import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


def run(name: str, picture: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """What an example prints; it draws its picture too."""
    monkeypatch.setattr("sys.argv", [name, str(picture)])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    assert picture.read_bytes().startswith(b"\x89PNG")
    return capsys.readouterr().out


def residuals(output: str) -> list[float]:
    """What the constraints are missed by."""
    return [float(text) for text in re.findall(r"residual (\S+) at most", output)]


@pytest.mark.drawn(2, of="examples")
@pytest.mark.parametrize(
    ("name", "count"),
    [("02_look_at_a_point.py", 2), ("03_keep_the_middle_up.py", 1), ("04_follow_a_tip_path.py", 1)],
)
def test_constraints_of_the_examples_hold(
    name: str, count: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every example with hard constraints reports residuals of at most 1e-6."""
    found = residuals(run(name, tmp_path / "picture.png", monkeypatch, capsys))
    assert len(found) == count
    assert max(found) <= 1e-6


@pytest.mark.drawn(2, of="examples")
def test_the_cost_of_the_example_is_made_small(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The heavier the weight, the less the mean holding effort."""
    output = run("08_prefer_low_torque.py", tmp_path / "picture.png", monkeypatch, capsys)
    efforts = [float(text) for text in re.findall(r"holding effort (\S+) N²m²", output)]
    assert len(efforts) == 3
    assert efforts[2] < efforts[1] < efforts[0]
    assert efforts[2] < 0.7 * efforts[0]
