"""Constraints and costs named on the command line: ``module:function`` or ``file.py:function``."""

import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module, util
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from ccm_opt.errors import ProblemError
from ccm_opt.ik.terms import Constraint, Cost, answer_of

TIME_TO_LOAD = 60.0
"""That a user's module may take [s]: it may load large libraries on a busy machine."""
Term = TypeVar("Term", Constraint, Cost)


def load_terms(references: Sequence[str], kind: type[Term]) -> tuple[Term, ...]:
    """The constraints, or costs, that references name.

    Args:
        references: each ``module:name`` or ``path/to/file.py:name``; modules are looked for in the working directory
            too. A name may stand for one term or for a list of them.
        kind: what is expected.

    Raises:
        ProblemError: a reference names nothing, or something else.
    """
    return tuple(term for reference in references for term in _named(reference, kind))


def _named(reference: str, kind: type[Term]) -> tuple[Term, ...]:
    # From the right, for a path on Windows begins with a drive and a colon.
    place, colon, name = reference.rpartition(":")
    if not (place and colon and name):
        raise ProblemError(f"'{reference}' names no {_word(kind)}; expected module:function or file.py:function")
    module = _module(reference, place)
    if not hasattr(module, name):
        raise ProblemError(f"'{reference}': module '{place}' has no '{name}'")
    found = getattr(module, name)
    terms = tuple(found) if isinstance(found, list | tuple) else (found,)
    for term in terms:
        if not isinstance(term, kind):
            raise ProblemError(
                f"'{reference}' is a {type(term).__name__}, expected a {kind.__name__}; decorate the function with "
                f"@ccm_opt.{_word(kind)}"
            )
    return terms


def _word(kind: type[Constraint] | type[Cost]) -> str:
    return kind.__name__.lower()


def _module(reference: str, place: str) -> ModuleType:
    load = partial(_from_file, Path(place)) if place.endswith(".py") else partial(_from_path, place)
    return answer_of(load, f"loading '{reference}'", TIME_TO_LOAD)


def _from_path(name: str) -> ModuleType:
    # The command line does not put the working directory on the path, as ``python -m`` would. It comes last, so that a
    # file there never stands in for a module of Python or of this package.
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    return import_module(name)


def _from_file(path: Path) -> ModuleType:
    name = f"ccm_opt_terms_{path.stem}"
    spec = util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.exists():
        raise FileNotFoundError(f"there is no file {path}")
    module = util.module_from_spec(spec)
    # Before it runs: dataclasses and pickles in the module look it up by its name.
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module
