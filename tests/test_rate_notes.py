"""What commands tell of speeds, accelerations and gravity that look as if they were in another unit."""

import json
from pathlib import Path

from .test_cli_output import run
from .test_feed_file import FED


def written(tmp_path: Path, **limits: float) -> Path:
    """A file with a feed axis and an arm of 0.4 m that has such limits."""
    given = {"feed_velocity": 0.1, "feed_acceleration": 0.5} | limits
    lines = "\n".join(f"{key} = {value}" for key, value in given.items())
    path = tmp_path / "fed.toml"
    path.write_text(FED.replace("feed_velocity = 0.1\nfeed_acceleration = 0.5", lines))
    return path


def test_rates_out_of_proportion_are_warned_of(tmp_path: Path) -> None:
    """Each in a line that names the key, the value in the file's unit, and how many arm lengths that is."""
    file = written(tmp_path, feed_velocity=80.0, feed_acceleration=300.0, tip_velocity=1e-4)
    told = " ".join(run("describe", file).stderr.split())
    assert "limits.feed_velocity is 80 m/s, or 2e+02 arm lengths/s" in told
    assert "limits.feed_acceleration is 300 m/s², or 7.5e+02 arm lengths/s²" in told
    assert "limits.tip_velocity is 0.0001 m/s, or 0.00025 arm lengths/s" in told


def test_gravity_of_no_planet_is_warned_of(tmp_path: Path) -> None:
    """It is in metres whatever the file counts in."""
    file = written(tmp_path)
    file.write_text(
        f"{file.read_text()}\n[simulation]\ngravity = [0, 0, -9810]\n".replace('"small"', '"small"\nunits="mm"')
    )
    assert "simulation.gravity is 9810 m/s²" in " ".join(run("describe", file).stderr.split())


def test_rates_of_feed_axes_are_not(tmp_path: Path) -> None:
    """A linear motor's are accepted without a word, in tables and for programs."""
    path = written(tmp_path, feed_velocity=4.0, feed_acceleration=60.0)
    assert not run("describe", path).stderr
    document = json.loads(run("describe", path, "--json").stdout)
    assert "warnings" not in document["results"][0] or not document["results"][0]["warnings"]
