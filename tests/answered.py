"""Answers what an ask-and-tell search asks for."""

from collections.abc import Callable, Generator
from typing import Any, TypeVar

from ccm_opt.driver.pipeline import Attempts

Asked = TypeVar("Asked")
Result = TypeVar("Result")


def answered(asking: Generator[Asked, Any, Result], attempt: Callable[[Asked], Any]) -> Result:
    """What comes of a search whose questions are answered by a function."""
    attempts = Attempts(asking)
    for asked in attempts:
        with attempts:
            attempts.found = attempt(asked)
    return attempts.result
