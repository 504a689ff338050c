"""The example of own constraints and a cost in space runs, ends, and does what it says."""

import re
import runpy
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


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
