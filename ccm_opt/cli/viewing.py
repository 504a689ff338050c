"""``ccm-opt view``: show a plan, or the problem of a file, in the browser, and let people drag its goal."""

import sys
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING

from ccm_opt.cli.cancelling import interrupt_met
from ccm_opt.cli.outcome import SOLVED, run_all
from ccm_opt.cli.output import output
from ccm_opt.cli.outside_files import outside_allowed
from ccm_opt.cli.stage_clock import stage_display
from ccm_opt.errors import ProblemError
from ccm_opt.files.export.reading_back import load_motion, load_recorded_problem
from ccm_opt.files.problem_file import load_problem
from ccm_opt.space.problem import in_the_plane

if TYPE_CHECKING:
    from ccm_opt.cli.view.app import ViewerApp


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
    if not output().quiet:
        sys.stderr.write(f"{app.frames.problem.name}: {app.address} shows it; Ctrl-C ends it\n")
    if browser:
        webbrowser.open(app.address)
    try:
        app.run()
    except KeyboardInterrupt:
        # The only way to end it, and so no failure.
        interrupt_met()
        return SOLVED
    return SOLVED


def viewer_of(item: Path, port: int) -> "ViewerApp":
    """The page of a plan.

    Raises:
        ProblemError: there is no such plan or problem, or the viewer is not installed.
        NoPlanFound: the problem has no plan.
    """
    try:
        from ccm_opt.cli.view.app import ViewerApp  # noqa: PLC0415 - loads viser
        from ccm_opt.cli.view.frames import MotionFrames  # noqa: PLC0415
    except ModuleNotFoundError as missing:
        raise ProblemError(
            f"the viewer needs the package {missing.name}; install it with: pip install 'ccm-opt[viewer]'"
        ) from missing
    from ccm_opt.driver.live_plan import LivePlan  # noqa: PLC0415 - loads casadi

    folder = item.is_dir()
    if folder:
        problem = load_recorded_problem(item, "ccm-opt view")
    else:
        problem = in_the_plane(load_problem(item, allow_outside=outside_allowed()), "ccm-opt view")
    with stage_display(problem.name) as clock:
        clock.begin("planning")
        live = LivePlan(problem) if LivePlan.suits(problem) else None
        clock.finish()
    if folder:
        motion = load_motion(item, problem.arm)
        return ViewerApp(MotionFrames(problem, motion.trajectory, motion.joints), live, port)
    if live is None:
        from ccm_opt.driver.pipeline import solve  # noqa: PLC0415 - loads toppra

        with stage_display(problem.name) as clock:
            solution = solve(problem, progress=clock)
        return ViewerApp(MotionFrames(problem, solution.trajectory, solution.joints), None, port, solution.checks)
    return ViewerApp(MotionFrames(problem, live.plan.trajectory, live.plan.joints), live, port, live.plan.checks)
