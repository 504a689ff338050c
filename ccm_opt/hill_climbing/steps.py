"""The steps that schemas are made of, and how a schema stops short."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.errors import Diagnosis, MotionNotFound


@dataclass(frozen=True)
class SchemaStep:
    """One configuration on the way.

    Attributes:
        schema: that made it, for example ``SCM-7``; two where they work together.
        configuration: where the arm is after it.
        stage: the part of a plan it belongs to, in words.
    """

    schema: str
    configuration: Configuration
    stage: str = ""


_Result = TypeVar("_Result")
Schema: TypeAlias = Generator[SchemaStep, None, Configuration]
"""Yields its steps, the arm's way from where it was; returns where the arm is at the end."""


class SchemaStopped(MotionNotFound):
    """A schema could not go on.

    Attributes:
        schema: its name.
        configuration: how far the arm came.
        reason: why, in words.
    """

    def __init__(self, schema: str, configuration: Configuration, reason: str) -> None:
        self.schema = schema
        self.configuration = configuration
        self.reason = reason
        advice = ("use planner.method nlp", "give the arm more room near its base")
        super().__init__(Diagnosis(f"{schema} stopped: {reason}", schema, advice, {"schema": schema}))


def run(schema: Generator[SchemaStep, None, _Result]) -> tuple[tuple[SchemaStep, ...], _Result]:
    """All steps of a schema and where it ends."""
    steps: list[SchemaStep] = []
    while True:
        try:
            steps.append(next(schema))
        except StopIteration as end:
            last: _Result = end.value
            return tuple(steps), last
