"""``ccm-opt draw``: the pictures of a written plan, made anew from its folder; and those that ``solve`` draws."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ccm_opt.cli.choices import FigureKind, FigureName
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.surroundings import no_search_for_cycles
from ccm_opt.core.files import put_file_or_refuse
from ccm_opt.errors import ProblemError
from ccm_opt.io.result_folders import folder_of
from ccm_opt.solution import ParetoPlans
from ccm_opt.solution.space_solution import AnySolution, SpaceSolution
from ccm_opt.viz.saved_plans import SavedSpacePlan, drawn, load

if TYPE_CHECKING:
    from ccm_opt.viz.arm_drawing import DrawnPlan
    from ccm_opt.viz.problem_section import PlanPages

STILL_FIGURES = tuple(name for name in FigureName if name not in {FigureName.GIF, FigureName.MP4})
"""What is drawn where nothing is asked for."""


@dataclass(frozen=True)
class DrawOptions:
    """What the command line asks for.

    Attributes:
        figures: what to draw; all still figures when empty.
        figure_format: of the figures.
        out: folder of the pictures; that of each plan when None.
    """

    figures: Sequence[FigureName] = ()
    figure_format: FigureKind = "png"
    out: Path | None = None


def plan_pictures(
    solution: AnySolution, kind: FigureKind = "png", plans: "PlanPages | None" = None
) -> Mapping[str, bytes]:
    """The pictures of a plan that was just made, by file name.

    Args:
        solution: the plan.
        kind: format of still pictures.
        plans: of which it is one, where there are several.
    """
    with no_search_for_cycles():
        from ccm_opt.viz.films import motion_gif, space_film  # noqa: PLC0415 - loads matplotlib
        from ccm_opt.viz.page import report_html  # noqa: PLC0415

    still = f"plan.{kind}"
    report = report_html(solution, pictures=(still, "motion.gif"), plans=plans).encode()
    if isinstance(solution, SpaceSolution):
        from ccm_opt.viz.space_plan import space_plan_picture  # noqa: PLC0415
        from ccm_opt.viz.space_views import SeenScene  # noqa: PLC0415

        scene = SeenScene(solution.problem)
        picture, film = space_plan_picture(solution, kind, scene=scene), space_film(solution, scene=scene).gif()
    else:
        from ccm_opt.viz.arm_drawing import DrawnPlan  # noqa: PLC0415
        from ccm_opt.viz.plan import plan_picture  # noqa: PLC0415

        plan = DrawnPlan.from_solution(solution)
        picture, film = plan_picture(plan, kind), motion_gif(plan)
    return {still: picture, "motion.gif": film, "report.html": report}


def pareto_pictures(found: ParetoPlans[AnySolution], kind: FigureKind = "png") -> Mapping[str, bytes]:
    """The pictures of several plans: all of the recommended one, a picture and a page of each, and the trade-off."""
    from ccm_opt.viz.page import report_html  # noqa: PLC0415
    from ccm_opt.viz.paper_figures import pareto_png  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.viz.problem_section import PlanPages  # noqa: PLC0415

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
        pictures[f"{folder_of(number)}/{still}"] = _still_picture(plan.solution, kind)
        pictures[f"{folder_of(number)}/{page}"] = report.encode()
    return pictures


def _still_picture(solution: AnySolution, kind: FigureKind) -> bytes:
    if isinstance(solution, SpaceSolution):
        from ccm_opt.viz.space_plan import space_plan_picture  # noqa: PLC0415 - loads matplotlib

        return space_plan_picture(solution, kind)
    from ccm_opt.viz.arm_drawing import DrawnPlan  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.viz.plan import plan_picture  # noqa: PLC0415

    return plan_picture(DrawnPlan.from_solution(solution), kind)


def draw_folders(folders: Sequence[Path], options: DrawOptions) -> int:
    """Draw the plans of folders; all are tried.

    Args:
        folders: output folders of ``ccm-opt solve``.
        options: the options.

    Returns:
        The exit code.
    """
    return run_all(folders, lambda folder: _draw(folder, options))


def _draw(folder: Path, options: DrawOptions) -> int:
    # Several plans in one folder would overwrite each other's pictures, so that each has a folder of its own there.
    out = folder if options.out is None else options.out / folder.resolve().name
    pictures = drawn_files(folder, options.figures or STILL_FIGURES, options.figure_format)
    for name, content in pictures.items():
        put_file_or_refuse(out / name, content, "choose another --out")
    written = [str(out / name) for name in pictures]
    show = "".join(f"{name}\n" for name in written)
    return print_result(lambda: sys.stdout.write(show), SOLVED, lambda: {"status": "drawn", "files": written})


def _drawn_in_space(plan: SavedSpacePlan, figures: Sequence[FigureName], kind: FigureKind) -> dict[str, bytes]:
    """The pictures of a written plan in space: those of the plane's that there are.

    Raises:
        ProblemError: naming what is asked for and drawn in the plane alone.
    """
    from ccm_opt.viz.films import motion_gif, motion_mp4  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.viz.space_plan import space_plan_picture  # noqa: PLC0415

    drawers: Mapping[FigureName, Callable[[], tuple[str, bytes]]] = {
        FigureName.PLAN: lambda: (f"plan.{kind}", space_plan_picture(plan, kind)),
        FigureName.SPACE: lambda: (f"space.{kind}", space_plan_picture(plan, kind)),
        FigureName.GIF: lambda: ("motion.gif", motion_gif(plan)),
        FigureName.MP4: lambda: ("motion.mp4", motion_mp4(plan)),
    }
    # Where nothing is asked for, the plan is drawn, which is a picture in space itself.
    asked = (FigureName.PLAN,) if tuple(figures) == STILL_FIGURES else figures
    if unknown := [str(name) for name in asked if name not in drawers]:
        raise ProblemError(f"{', '.join(unknown)}: drawn in the plane alone, and '{plan.problem.name}' is in space")
    return dict(drawers[name]() for name in asked)


def drawn_files(folder: Path, figures: Sequence[FigureName], kind: FigureKind = "png") -> dict[str, bytes]:
    """The pictures of a written plan by file name.

    Args:
        folder: an output folder of ``ccm-opt solve``.
        figures: what to draw.
        kind: format of still figures.

    Raises:
        ProblemError: for an unreadable folder, or a video without ffmpeg.
        VerificationError: the folder holds no plan.
    """
    loaded = load(folder)
    if isinstance(loaded, SavedSpacePlan):
        return _drawn_in_space(loaded, figures, kind)
    plan = drawn(loaded)
    from ccm_opt.viz import paper_figures  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.viz.films import motion_gif, motion_mp4  # noqa: PLC0415
    from ccm_opt.viz.plan import plan_picture  # noqa: PLC0415

    drawers: Mapping[FigureName, Callable[[DrawnPlan, FigureKind], bytes]] = {
        FigureName.PLAN: plan_picture,
        FigureName.CURVES: paper_figures.curves_picture,
        FigureName.STEPS: paper_figures.steps_picture,
        FigureName.LINKS: paper_figures.links_picture,
        FigureName.SPACE: paper_figures.space_picture,
    }
    files = {f"{name}.{kind}": drawers[name](plan, kind) for name in figures if name in drawers}
    if FigureName.GIF in figures:
        files["motion.gif"] = motion_gif(plan)
    if FigureName.MP4 in figures:
        files["motion.mp4"] = motion_mp4(plan)
    return files
