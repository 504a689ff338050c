"""Pictures, films and HTML reports of plans and simulations.

Users import this package as ``ccm_opt.plotting``. The names in ``__all__`` are public; each loads matplotlib on first
use::

    from ccm_opt import plotting

    figure = plotting.plan_figure(plotting.PlanDrawing.from_solution(solution))
    plotting.draw_poses(figure.axes[0], solution.problem.arm.joint_positions_at(solution.trajectory.positions[::50]))
    figure.savefig("plan.pdf")

Functions that take ``axes`` draw in metres. Figures are matplotlib figures, so that everything can be changed later.
``solution.plot()`` is short for ``plan_figure``. Other parts of ``ccm_opt`` do not draw.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ccm_opt.viz.arm_drawing import PlanDrawing, draw_body, draw_poses, draw_tip_path, draw_workspace
    from ccm_opt.viz.figure_files import label_axes
    from ccm_opt.viz.films import motion_gif, motion_mp4
    from ccm_opt.viz.paper_figures import curves_picture, links_picture, pareto_figure, space_picture, steps_picture
    from ccm_opt.viz.plan import draw_goals, plan_figure
    from ccm_opt.viz.pose_picture import pose_figure, reach_figure
    from ccm_opt.viz.settings import FilmSettings

__all__ = [
    "FilmSettings",
    "PlanDrawing",
    "curves_picture",
    "draw_body",
    "draw_goals",
    "draw_poses",
    "draw_tip_path",
    "draw_workspace",
    "label_axes",
    "links_picture",
    "motion_gif",
    "motion_mp4",
    "pareto_figure",
    "plan_figure",
    "pose_figure",
    "reach_figure",
    "space_picture",
    "steps_picture",
]

_NAMES = {
    "arm_drawing": ("PlanDrawing", "draw_body", "draw_poses", "draw_tip_path", "draw_workspace"),
    "figure_files": ("label_axes",),
    "films": ("motion_gif", "motion_mp4"),
    "paper_figures": ("curves_picture", "links_picture", "pareto_figure", "space_picture", "steps_picture"),
    "plan": ("draw_goals", "plan_figure"),
    "pose_picture": ("pose_figure", "reach_figure"),
    "settings": ("FilmSettings",),
}
"""Public names, by the module that defines them."""


def __getattr__(name: str) -> object:
    """Return a public name of the package, importing the module that defines it on first use."""
    for module, names in _NAMES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module 'ccm_opt.plotting' has no attribute {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
