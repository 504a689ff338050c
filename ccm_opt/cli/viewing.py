"""``ccm-opt view``: show a plan, or the problem of a file, in the browser, and let people drag its goal."""

import sys
import webbrowser
from pathlib import Path
from socket import socket
from typing import TYPE_CHECKING, Any

from ccm_opt.cli.cancelling import interrupt_met, leave_at_once
from ccm_opt.cli.outcome import SOLVED, run_all
from ccm_opt.cli.output import output, outside_allowed
from ccm_opt.cli.stage_clock import stage_display
from ccm_opt.errors import ProblemError
from ccm_opt.io.reading import load_problem
from ccm_opt.io.reading_back import load_any_problem, load_motion
from ccm_opt.problem import Problem

if TYPE_CHECKING:
    from ccm_opt.cli.view.app import ViewerApp
    from ccm_opt.driver.live_plan import LivePlan
    from ccm_opt.solution import Solution


def view_item(item: Path, port: int, *, browser: bool) -> int:
    """Show one plan until Ctrl-C.

    Args:
        item: a problem file, or an output folder of ``ccm-opt solve``.
        port: of the page, on this machine alone.
        browser: whether to open the page.

    Returns:
        The exit code.
    """
    return run_all([item], lambda each: _view(each, port, browser=browser))


def _view(item: Path, port: int, *, browser: bool) -> int:
    app = viewer_of(item, port)
    try:
        if not output().quiet:
            sys.stderr.write(f"{app.frames.problem.name}: {app.address} shows it; Ctrl-C ends it\n")
        if browser:
            webbrowser.open(app.address)
        app.run()
    except KeyboardInterrupt:
        # The only way to end it, and so no failure; whatever still waits for a page that does not answer is left.
        interrupt_met()
        leave_at_once(SOLVED)
    return SOLVED


def viewer_of(item: Path, port: int) -> "ViewerApp":
    """The page of a plan.

    Raises:
        ProblemError: there is no such plan or problem, the port is taken, or the viewer is not installed.
        NoPlanFound: the problem has no plan.
    """
    try:
        from ccm_opt.cli.view.app import claim_port  # noqa: PLC0415 - loads viser
    except ModuleNotFoundError as missing:
        raise ProblemError(
            f"the viewer needs the package {missing.name}; install it with: pip install viser"
        ) from missing

    problem = load_any_problem(item) if item.is_dir() else load_problem(item, allow_outside=outside_allowed())
    door = claim_port(port)
    try:
        return _viewer_at(door, item, problem)
    except BaseException:
        door.close()
        raise


def _viewer_at(door: socket, item: Path, problem: Problem) -> "ViewerApp":
    """Plan a problem and show it on an open socket; of a folder, show the motion that is written there."""
    from ccm_opt.cli.view.app import ViewerApp  # noqa: PLC0415 - loads viser
    from ccm_opt.cli.view.frames import MotionFrames  # noqa: PLC0415

    with stage_display(problem.name) as clock:
        clock.begin("planning")
        live = _live_plan(problem)
        clock.finish()
    if item.is_dir():
        motion = load_motion(item, problem.arm)
        return ViewerApp(MotionFrames(problem, motion.trajectory, motion.joints), live, door)
    if live is None:
        from ccm_opt.driver.pipeline import solve  # noqa: PLC0415 - loads toppra

        either: Any = problem
        with stage_display(problem.name) as clock:
            solution: Solution = solve(either, progress=clock)
        return ViewerApp(MotionFrames(problem, solution.trajectory, solution.joints), None, door, solution.checks)
    plan = live.plan
    return ViewerApp(MotionFrames(problem, plan.trajectory, plan.joints), live, door, plan.checks)


def _live_plan(problem: Problem) -> "LivePlan | None":
    """The plan that follows drags; None where the problem is none for it.

    Raises:
        NoPlanFound: the problem has no plan.
    """
    from ccm_opt.driver.live_plan import LivePlan  # noqa: PLC0415 - loads casadi

    return LivePlan(problem) if LivePlan.suits(problem) else None
