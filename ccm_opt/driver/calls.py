"""Checks of calls."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ccm_opt.core.expected import expect, expect_callable, expect_method
from ccm_opt.driver.legs import Planner, Retimer
from ccm_opt.errors import ProblemError
from ccm_opt.problem import Problem
from ccm_opt.problem.options import options_without_effect

if TYPE_CHECKING:
    from ccm_opt.driver.settings import Settings


def expect_arguments(
    *,
    progress: Callable[..., Any] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    settings: "Settings | None" = None,
    **flags: bool,
) -> None:
    """Refuse arguments of another kind than they are meant to be; None stands for the default.

    Args:
        progress: a function.
        planner: an object with the method ``plan``.
        retimer: an object with the method ``retime``.
        settings: of all stages.
        flags: true or false, by name.

    Raises:
        ProblemError: naming what was expected, and what to write.
    """
    expect_callable(progress, "a function for progress=", "for example progress=print")
    expect_method(planner, ["plan"], "a planner, an object with plan(problem)", "ccm_opt.BuiltInPlanner() is one")
    expect_method(
        retimer, ["retime"], "a retimer, an object with retime(problem, path)", "ccm_opt.BuiltInRetimer() is one"
    )
    if settings is not None:
        from ccm_opt.driver.settings import Settings  # noqa: PLC0415 - loads the settings of all planners

        expect(settings, Settings, "ccm_opt.Settings for settings=")
    for name, value in flags.items():
        expect(value, bool, f"True or False for {name}=")


def refuse_without_effect(problem: Problem) -> None:
    """Refuse planner options that do nothing for a problem, as its file would have been.

    Raises:
        ProblemError: naming them, and why they do nothing.
    """
    found = options_without_effect(problem.planner, in_space=problem.dimension == 3)
    lines = [f"planner.{name}: {why}" for name, why in found]
    if lines:
        raise ProblemError(f"problem '{problem.name}' cannot be used:\n" + "\n".join(f"  {line}" for line in lines))
