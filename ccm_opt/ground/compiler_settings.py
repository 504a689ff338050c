"""The numbers of compiling C."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CompilerSettings:
    """How the C compiler is run.

    Attributes:
        time_limit: a compiler that takes longer than this hangs [s]; it takes 0.4 s. Taste.
    """

    time_limit: float = 300.0


DEFAULT_COMPILER = CompilerSettings()
"""What compiling uses unless it is given others."""
