"""The page and the film of a plan: self-contained, complete, and honest about what they show."""

import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from ccm_opt.files.plotting.animation import motion_gif
from ccm_opt.files.report.page import report_html
from ccm_opt.solution import Solution


def page_data(page: str) -> dict[str, list[object]]:
    """What the page's script is given."""
    found = re.search(r'<script id="data" type="application/json">(.*?)</script>', page, re.DOTALL)
    assert found is not None
    data: dict[str, list[object]] = json.loads(found[1])
    return data


def test_the_page_shows_the_whole_motion(small_solution: Solution) -> None:
    """The first and last pose of the page are those of the plan, and every check has its row."""
    page = report_html(small_solution)
    data = page_data(page)
    np.testing.assert_allclose(data["poses"][0], small_solution.joint_positions[0], atol=1e-5)
    np.testing.assert_allclose(data["poses"][-1], small_solution.joint_positions[-1], atol=1e-5)
    assert data["time"][-1] == pytest.approx(small_solution.trajectory.duration, abs=1e-4)
    assert page.count("<tr><td>") == len(small_solution.checks) + len(small_solution.timings)
    assert "{{" not in page


def test_the_page_loads_nothing(small_solution: Solution) -> None:
    """No link, image or script of the page comes from elsewhere."""
    sources: list[tuple[str, str | None]] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            del tag
            sources.extend(pair for pair in attrs if pair[0] in {"src", "href"})

    Reader().feed(report_html(small_solution))
    assert sources == []


def test_names_cannot_break_the_page(small_solution: Solution) -> None:
    """Markup in a description stands there as text."""
    named = replace(small_solution.problem, description="</script><b>bold</b>")
    page = report_html(replace(small_solution, problem=named))
    assert "<b>bold</b>" not in page
    assert "&lt;b&gt;bold" in page


def test_the_film_has_the_motion_in_real_time(small_solution: Solution) -> None:
    """Its frames last as long as the motion, and the first and last differ."""
    film = Image.open(BytesIO(motion_gif(small_solution)))
    shown = 0.0
    pictures = []
    for k in range(film.n_frames):
        film.seek(k)
        pictures.append(np.asarray(film.convert("RGB")))
        shown += film.info["duration"] / 1000.0
    assert shown - 0.9 == pytest.approx(small_solution.trajectory.duration, rel=0.15)
    assert np.any(pictures[0] != pictures[-1])
