"""The numbers of compiling C."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CompilerSettings:
    """How the C compiler is run.

    Attributes:
        time_limit: a compiler that takes longer than this hangs [s]; it takes 0.4 s. Taste.
        most_words: of what it says are read, in bytes. Taste.
    """

    time_limit: float = 20.0
    most_words: int = 10_000


DEFAULT_COMPILER = CompilerSettings()
"""What compiling uses unless it is given others."""
