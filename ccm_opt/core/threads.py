"""Linear algebra on one thread, so that the same problem gives the same bytes whatever the machine's settings.

BLAS adds up in an order that depends on how many threads share a sum, and a motion that differs by 1e-14 is another
file. The matrices here are small, and faster on one thread besides.
"""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


def on_one_thread(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
    """The same function, with BLAS on one thread while it runs; afterwards as before."""

    @wraps(function)
    def limited(*args: _Parameters.args, **kwargs: _Parameters.kwargs) -> _Result:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
