"""Checks of calls, and the words of the file in what they raise."""

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

from ccm_opt.core.expected import expect, expect_callable, expect_method
from ccm_opt.core.length_words import words_in
from ccm_opt.planning.legs import Planner, Retimer

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


_Subject = TypeVar("_Subject")
_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def in_words_of_its_file(
    function: Callable[Concatenate[_Subject, _Parameters], _Result],
) -> Callable[Concatenate[_Subject, _Parameters], _Result]:
    """The same function; lengths in words are in the unit of its problem's file while it runs.

    The problem is the first argument, or that argument's attribute ``problem``. Who gives something else is told so by
    the function itself.
    """

    @wraps(function)
    def said(*args: object, **kwargs: object) -> _Result:
        subject = args[0] if args else next(iter(kwargs.values()), None)
        problem = getattr(subject, "problem", subject)
        with words_in(getattr(problem, "length_unit", "m")):
            return function(*args, **kwargs)  # type: ignore[arg-type]

    return said
