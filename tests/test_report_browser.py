"""The pages in a browser: their scripts run without an error and show at a time what the plan has at that time."""

import re
import shutil
import subprocess
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from ccm_opt.cli.compare.comparison_page import comparison_page
from ccm_opt.cli.compare.running import Comparison
from ccm_opt.cli.compare.runs import Run
from ccm_opt.core.errors import Diagnosis, Finding
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution
from ccm_opt.viz.failure_page import failure_html
from ccm_opt.viz.page import report_html

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), "")
pytestmark = [
    pytest.mark.planning,
    pytest.mark.skipif(not BROWSER, reason="needs a browser that runs without a window"),
]


def rendered(page: str, folder: Path, fragment: str = "", *, software: bool = False) -> str:
    """The page's elements once its scripts have run, with WebGL by software; what they complain of fails the test."""
    file = folder / "report.html"
    file.write_text(page, encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--enable-logging=stderr", "--virtual-time-budget=5000"]
    options += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"] if software else ["--disable-gpu"]
    command = [BROWSER, *options, f"--user-data-dir={folder / 'profile'}", "--dump-dom", f"{file.as_uri()}{fragment}"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    complaints = [line for line in run.stderr.splitlines() if "CONSOLE" in line]
    assert complaints == []
    return run.stdout


def now(dom: str, key: str) -> str:
    """What the page's readout says."""
    found = re.search(rf'<dd data-now="{key}">([^<]*)</dd>', dom)
    assert found is not None
    return found[1]


def test_the_page_shows_the_arm_at_a_time(small_solution: Solution, tmp_path: Path) -> None:
    """Tip and heading in the readout, and the number of charts, are those of the plan."""
    dom = rendered(report_html(small_solution), tmp_path, "#t=0.5")
    k = int(np.searchsorted(small_solution.trajectory.time, 0.5))
    x, y = 1e3 * small_solution.joint_positions[k, -1]
    heading = np.rad2deg(small_solution.problem.arm.headings(small_solution.trajectory.bend_angles[k])[-1])
    shown = [float(value) for value in re.findall(r"[\d.]+", now(dom, "tip"))]
    assert shown == pytest.approx([x, y], abs=1.0)
    assert float(now(dom, "heading").rstrip("°")) == pytest.approx(heading, abs=0.1)
    assert now(dom, "time") == "0.50 s"
    assert 'data-ready="plan"' in dom
    assert len(re.findall(r'<svg role="img"[^>]* class="chart"', dom)) == dom.count("<figure")


def test_the_page_of_a_failure_draws_its_reason(small_problem: Problem, tmp_path: Path) -> None:
    """The circle of reach and its words are in the scene, and the wall that is named is marked."""
    finding = Finding("too short", "r", place=(0.9, 0.0), measured=0.9, allowed=0.4, obstacles=("post",))
    dom = rendered(failure_html(small_problem, "infeasible", Diagnosis("r", "s", findings=(finding,))), tmp_path)
    assert 'data-ready="failure"' in dom
    assert '<circle class="reach"' in dom
    assert "500 mm too short</text>" in dom
    assert 'class="wall blocking"' in dom


def test_the_page_of_a_comparison_draws_its_curves(tmp_path: Path) -> None:
    """There is a step for every solved run, and a point for every problem that both methods solve."""
    one = (
        Run("1", "one", "nlp", "solved", figures={"cpu_s": 0.5}),
        Run("2", "one", "nlp-paul", "solved", figures={"cpu_s": 2.0}),
    )
    two = (
        Run("3", "two", "nlp", "solved", figures={"cpu_s": 1.0}),
        Run("4", "two", "nlp-paul", "no plan", reason="why"),
    )
    dom = rendered(comparison_page(Comparison(("one", "two"), ("nlp", "nlp-paul"), (one, two))), tmp_path)
    assert 'data-ready="comparison"' in dom
    first, second = (found.count("V") for found in re.findall(r'<path class="curve"[^>]* d="([^"]*)"', dom))
    assert (first, second) == (2, 1)
    assert dom.count('class="point"') == 1


def test_the_viewer_draws_with_fewer_pixels_only_while_something_moves(tmp_path: Path) -> None:
    """Without a graphics card, frames in quick succession are coarse, those after a rest and the canvas's size not."""
    script = (files("ccm_opt.cli.view") / "coarse.js").read_text(encoding="utf-8")
    draw = """
        const canvas = document.createElement("canvas");
        canvas.width = canvas.height = 100;
        const gl = canvas.getContext("webgl2");
        document.title = [0, 16, 500, 1500, 1516].map(time => {
          Object.defineProperty(document.timeline, "currentTime", { value: time, configurable: true });
          gl.viewport(0, 0, 100, 100);
          gl.clear(gl.COLOR_BUFFER_BIT);
          return [gl.drawingBufferWidth, gl.getParameter(gl.VIEWPORT)[3], canvas.width].join(" ");
        }).join(", ");"""
    dom = rendered(f"<title></title><script>{script}</script><script>{draw}</script>", tmp_path, software=True)
    assert re.findall(r"<title>(.*)</title>", dom) == ["100 100 100, 55 55 100, 55 55 100, 100 100 100, 55 55 100"]
