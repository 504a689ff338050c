"""The moving arm of the front page is sound, and the gallery shows a picture for every file that its commands draw."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from PIL import Image

import ccm_opt

ROOT = Path(__file__).parent.parent
IMAGES = ROOT / "docs" / "images"
SVG = "{http://www.w3.org/2000/svg}"
LARGEST = 150_000
"""Of a picture of the gallery [bytes]."""


def test_the_moving_arm_keeps_the_length_of_its_links() -> None:
    """At every written time the drawn links are as long as those of the problem, to the drawing's whole millimetres."""
    drawing = ET.parse(IMAGES / "moving-arm.svg").getroot()  # noqa: S314 - our own file
    problem = ccm_opt.load_problem(ROOT / "problems" / "swan-neck.toml")
    animations = list(drawing.iter(f"{SVG}animate"))
    assert animations
    for animation in animations:
        frames = [[point.split(",") for point in frame.split()] for frame in animation.attrib["values"].split(";")]
        times = np.array(animation.attrib["keyTimes"].split(";"), dtype=float)
        points = np.array(frames, dtype=float)
        assert points.shape == (len(times), problem.arm.links + 1, 2)
        assert times[0] == 0.0
        assert times[-1] == 1.0
        assert np.all(np.diff(times) >= 0.0)
        lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
        np.testing.assert_allclose(lengths, 1e3 * problem.arm.link_length, atol=1.5)


def test_the_moving_arm_stands_still_where_that_is_asked_for() -> None:
    """The drawing has a part that does not move, shown to readers who ask for less motion, and colours for the dark."""
    text = (IMAGES / "moving-arm.svg").read_text()
    still = text[text.index('<g class="still">') :]
    assert "prefers-reduced-motion: reduce" in text
    assert "prefers-color-scheme: dark" in text
    assert "<animate" not in still
    assert still.count('class="body"') >= 3


def test_the_gallery_has_every_picture_and_no_other() -> None:
    """Every file that a command of the gallery or of the page on the paper draws is kept, small, and shown."""
    pages = "".join((ROOT / "docs" / page).read_text() for page in ("gallery.md", "the-paper-claim-by-claim.md"))
    drawn = set(re.findall(r"<!-- picture: \S+ as (\S+) -->", pages))
    shown = set(re.findall(r"\]\(images/gallery/([^\s)]+)\)", pages))
    kept = {file.name for file in (IMAGES / "gallery").iterdir()}
    assert len(drawn) > 12
    assert drawn == shown == kept
    for name in kept:
        assert (IMAGES / "gallery" / name).stat().st_size < LARGEST
        with Image.open(IMAGES / "gallery" / name) as picture:
            assert picture.width <= 1100
