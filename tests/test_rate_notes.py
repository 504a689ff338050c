"""What commands tell of rates of a feed axis that look as if they were in the unit of the file's lengths."""

import json
from pathlib import Path

from .test_cli_output import run
from .test_feed_file import FED


def written(tmp_path: Path, velocity: float, acceleration: float) -> Path:
    """A file with a feed axis that has such limits."""
    text = FED.replace("feed_velocity = 0.1", f"feed_velocity = {velocity}")
    path = tmp_path / "fed.toml"
    path.write_text(text.replace("feed_acceleration = 0.5", f"feed_acceleration = {acceleration}"))
    return path


def test_rates_that_no_feed_axis_has_are_warned_of(tmp_path: Path) -> None:
    """Each in a line that names the key, the value with its unit, and the value that was probably meant."""
    told = " ".join(run("describe", written(tmp_path, 80.0, 300.0)).stderr.split())
    assert "limits.feed_velocity is 80 m/s" in told
    assert "if 80 mm/s is meant, write 0.08" in told
    assert "limits.feed_acceleration is 300 m/s²" in told
    assert "if 300 mm/s² is meant, write 0.3" in told


def test_rates_of_feed_axes_are_not(tmp_path: Path) -> None:
    """A linear motor's are accepted without a word, in tables and for programs."""
    path = written(tmp_path, 4.0, 90.0)
    assert not run("describe", path).stderr
    document = json.loads(run("describe", path, "--json").stdout)
    assert "warnings" not in document["results"][0] or not document["results"][0]["warnings"]
