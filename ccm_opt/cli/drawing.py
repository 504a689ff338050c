"""The commands ``draw``, pictures of a plan, and ``view``, a plan in the browser; and the pictures of ``solve``."""

import sys
import webbrowser
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from socket import socket
from typing import TYPE_CHECKING

from ccm_opt.cli.cancelling import interrupt_met, leave_at_once
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.output import FigureKind, FigureName, output
from ccm_opt.cli.stage_clock import stage_display
from ccm_opt.cli.surroundings import no_search_for_cycles
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.files import put_file_or_refuse
from ccm_opt.io.reading import load_problem
from ccm_opt.io.reading_back import load_any_problem
from ccm_opt.io.result_folders import folder_of
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ParetoPlans, Solution
from ccm_opt.viz.saved_plans import plan_drawing, read_plan

if TYPE_CHECKING:
    from ccm_opt.cli.view.app import ViewerApp
    from ccm_opt.viz.arm_drawing import PlanDrawing
    from ccm_opt.viz.page_sections import PlanPages

STILL_FIGURES = tuple(name for name in FigureName if name not in {FigureName.GIF, FigureName.MP4, FigureName.REPORT})
"""Figures that ``draw`` makes by default: all but films and the report."""


def plan_pictures(
    solution: Solution, kind: FigureKind = "png", plans: "PlanPages | None" = None
) -> Mapping[str, bytes]:
    """Return the pictures, film and HTML report of a new plan, as file contents by file name.

    Args:
        solution: the plan.
        kind: file format of still pictures.
        plans: all plans of the problem, if there are several.
    """
    with no_search_for_cycles():
        from ccm_opt.viz.arm_drawing import PlanDrawing  # noqa: PLC0415 - loads matplotlib
        from ccm_opt.viz.films import motion_gif  # noqa: PLC0415
        from ccm_opt.viz.page import report_html  # noqa: PLC0415
        from ccm_opt.viz.plan import plan_picture  # noqa: PLC0415
        from ccm_opt.viz.scene_views import SceneViews  # noqa: PLC0415

    still = f"plan.{kind}"
    report = report_html(solution, pictures=(still, "motion.gif"), plans=plans).encode()
    plan = PlanDrawing.from_solution(solution)
    # The picture and the film show the same bodies, which are prepared once.
    scene = SceneViews(plan.problem) if plan.problem.dimension == 3 else None
    return {still: plan_picture(plan, kind, scene), "motion.gif": motion_gif(plan, scene), "report.html": report}


def pareto_pictures(found: ParetoPlans, kind: FigureKind = "png") -> Mapping[str, bytes]:
    """Return the pictures and reports of a set of Pareto-optimal plans, as file contents by file name.

    These are the recommended plan's, those of each plan in its subfolder, and the chart of the trade-off.
    """
    from ccm_opt.viz.arm_drawing import PlanDrawing  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.viz.page import report_html  # noqa: PLC0415
    from ccm_opt.viz.page_sections import PlanPages  # noqa: PLC0415
    from ccm_opt.viz.paper_figures import pareto_png  # noqa: PLC0415
    from ccm_opt.viz.plan import plan_picture  # noqa: PLC0415

    page = "report.html"
    numbers = range(1, len(found.plans) + 1)
    from_above = (f"{folder_of(number)}/{page}" if number != found.recommended else "" for number in numbers)
    pictures = dict(plan_pictures(found.best, kind, PlanPages(found, tuple(from_above))))
    pictures["pareto.png"] = pareto_png(found)
    for number, plan in zip(numbers, found.plans, strict=True):
        if plan.solution is None:
            continue
        still = f"plan.{kind}"
        beside = tuple(f"../{other}/{page}" if other != number else "" for other in numbers)
        report = report_html(plan.solution, pictures=(still,), plans=PlanPages(found, beside))
        pictures[f"{folder_of(number)}/{still}"] = plan_picture(PlanDrawing.from_solution(plan.solution), kind)
        pictures[f"{folder_of(number)}/{page}"] = report.encode()
    return pictures


def draw_folders(
    folders: Sequence[Path], figures: Sequence[FigureName] = (), kind: FigureKind = "png", out: Path | None = None
) -> int:
    """Draw the plan in every output folder and return the exit code; after a failure the other folders are still drawn.

    Args:
        folders: output folders of ``ccm-opt solve``.
        figures: figures to draw; all still figures when empty.
        kind: file format of still figures.
        out: parent folder for the pictures; None for the folder of each plan.

    Returns:
        The exit code, see ``outcome``.
    """

    def draw(folder: Path) -> int:
        # Pictures of several plans in one folder would overwrite each other, so each plan gets a folder of its own.
        place = folder if out is None else out / folder.resolve().name
        pictures = draw_figures(folder, figures or STILL_FIGURES, kind)
        for name, content in pictures.items():
            put_file_or_refuse(place / name, content, "choose another --out")
        written = [str(place / name) for name in pictures]
        show = "".join(f"{name}\n" for name in written)
        return print_result(lambda: sys.stdout.write(show), SOLVED, lambda: {"status": "drawn", "files": written})

    return run_all(folders, draw)


def draw_figures(folder: Path, figures: Sequence[FigureName], kind: FigureKind = "png") -> dict[str, bytes]:
    """Return pictures of the plan in an output folder, as file contents by file name.

    Args:
        folder: an output folder of ``ccm-opt solve``.
        figures: figures to draw.
        kind: file format of still figures.

    Raises:
        ProblemError: the folder is not readable, a figure exists for planar arms only, or ffmpeg is missing.
        VerificationError: the folder holds no plan, or a report is asked for and the verifier rejects the plan.
    """
    plan = plan_drawing(read_plan(folder))
    from ccm_opt.viz import paper_figures  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.viz.films import motion_gif, motion_mp4  # noqa: PLC0415
    from ccm_opt.viz.page import report_html  # noqa: PLC0415
    from ccm_opt.viz.plan import plan_picture  # noqa: PLC0415

    stills: dict[FigureName, Callable[[PlanDrawing, FigureKind], bytes]] = {
        FigureName.PLAN: plan_picture,
        FigureName.SPACE: plan_picture,
    }
    if plan.problem.dimension == 3:
        # By default, only the plan is drawn in space.
        figures = (FigureName.PLAN,) if tuple(figures) == STILL_FIGURES else figures
    else:
        stills |= {
            FigureName.CURVES: paper_figures.curves_picture,
            FigureName.STEPS: paper_figures.steps_picture,
            FigureName.LINKS: paper_figures.links_picture,
            FigureName.SPACE: paper_figures.space_picture,
        }
    films: dict[FigureName, Callable[[PlanDrawing], bytes]] = {FigureName.GIF: motion_gif, FigureName.MP4: motion_mp4}
    if unknown := [str(name) for name in figures if name not in {*stills, *films, FigureName.REPORT}]:
        raise ProblemError(f"{', '.join(unknown)}: available in the plane only; '{plan.problem.name}' is in space")
    files = {f"{name}.{kind}": stills[name](plan, kind) for name in figures if name in stills}
    if FigureName.REPORT in figures:
        from ccm_opt.driver.saved_solution import load  # noqa: PLC0415 - slow to import

        files["report.html"] = report_html(load(folder), pictures=None).encode()
    return files | {f"motion.{name}": films[name](plan) for name in figures if name in films}


def view_item(item: Path, port: int, *, browser: bool) -> int:
    """Show a plan in the browser until Ctrl-C, and return the exit code.

    Args:
        item: a problem file, or an output folder of ``ccm-opt solve``.
        port: port on which the page is served, to this machine only.
        browser: whether to open the page in a browser.

    Returns:
        The exit code, see ``outcome``.
    """
    return run_all([item], lambda each: _view(each, port, browser=browser))


def _view(item: Path, port: int, *, browser: bool) -> int:
    app = plan_viewer(item, port)
    try:
        if not output().quiet:
            sys.stderr.write(f"{app.frames.problem.name}: open {app.address}; press Ctrl-C to stop\n")
        if browser:
            webbrowser.open(app.address)
        app.run()
    except KeyboardInterrupt:
        # Ctrl-C is the usual way to end the viewer, so it is no failure. Threads that wait for a page are abandoned.
        interrupt_met()
        leave_at_once(SOLVED)
    return SOLVED


def plan_viewer(item: Path, port: int) -> "ViewerApp":
    """Return the viewer of a plan, with its server started but the playback loop not yet running.

    Raises:
        ProblemError: the plan or problem does not exist, the port is in use, or the viewer
            is not installed.
        NoPlanFound: the problem has no plan.
        VerificationError: the verifier rejects the plan of a folder.
    """
    try:
        from ccm_opt.cli.view.app import claim_port  # noqa: PLC0415 - loads viser
    except ModuleNotFoundError as missing:
        raise ProblemError(
            f"the viewer needs the package {missing.name}; install it with: pip install viser"
        ) from missing

    problem = load_any_problem(item) if item.is_dir() else load_problem(item, allow_outside=output().allow_outside)
    door = claim_port(port)
    try:
        return _serve_viewer(door, item, problem)
    except BaseException:
        door.close()
        raise


def _serve_viewer(door: socket, item: Path, problem: Problem) -> "ViewerApp":
    """Return the viewer on an open socket, showing the motion in an output folder, or a new plan for a problem file."""
    from ccm_opt.cli.view.app import ViewerApp  # noqa: PLC0415 - loads viser
    from ccm_opt.cli.view.frames import MotionFrames  # noqa: PLC0415
    from ccm_opt.driver.live_plan import LivePlan  # noqa: PLC0415 - loads casadi
    from ccm_opt.driver.saved_solution import load  # noqa: PLC0415

    if item.is_dir():
        plan = load(item)
        live = LivePlan.from_plan(plan) if LivePlan.suits(plan.problem) else None
        return ViewerApp(MotionFrames(problem, plan.trajectory, plan.joints), live, door, plan.checks)
    with stage_display(problem.name) as clock:
        clock.begin("planning")
        live = LivePlan(problem) if LivePlan.suits(problem) else None
        clock.finish()
    if live is None:
        from ccm_opt.driver.pipeline import solve  # noqa: PLC0415 - loads toppra

        with stage_display(problem.name) as clock:
            plan = solve(problem, progress=clock)
        # A tour is dragged in the order that was found.
        live = LivePlan.from_plan(plan) if LivePlan.suits(plan.problem) else None
    else:
        plan = live.plan
    return ViewerApp(MotionFrames(plan.problem, plan.trajectory, plan.joints), live, door, plan.checks)
