"""What the driver says of a problem is said in the unit of its file."""

from collections.abc import Callable
from functools import wraps
from typing import Concatenate, ParamSpec, TypeVar

from ccm_opt.ground.length_words import words_in

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
