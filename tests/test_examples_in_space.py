"""The examples in space run, end, and do what they say."""

import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.mark.drawn(2, of="examples")
def test_the_camera_ends_with_the_spot_in_its_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By the joints of the last sample the spot is within four degrees of the axis, and both residuals are kept."""
    picture = tmp_path / "look.png"
    monkeypatch.setattr("sys.argv", ["look", str(picture)])
    runpy.run_path(str(EXAMPLES / "12_look_at_a_spot_in_space.py"), run_name="__main__")
    told = capsys.readouterr().out
    off = re.search(r"the spot is (\S+)° off", told)
    assert off is not None
    assert float(off[1]) <= 4.0
    residuals = [float(text) for text in re.findall(r"residual (\S+) at most", told)]
    assert len(residuals) == 2
    assert max(residuals) <= 1e-6
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_tip_is_driven_round(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The driven motion is a plan in the folder that was asked for."""
    monkeypatch.setattr("sys.argv", ["drive", str(tmp_path)])
    runpy.run_path(str(EXAMPLES / "13_drive_by_hand.py"), run_name="__main__")
    assert list(tmp_path.rglob("solution.json"))
