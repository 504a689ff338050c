"""Which problems a comparison is made on: named suites of random scenes, the shared files, or given files."""

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from ccm_opt.comparison.scenes import Scene, clutter, corridor, open_space
from ccm_opt.comparison.space_suites import SPACE, SPACE_SUITES, space_maker
from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file import load_problem
from ccm_opt.space.problem import AnyProblem, SpaceProblem
from ccm_opt.space.scene.bodies import MeshBody

SHARED = "shared"
"""The suite of the problem files that come with the package."""
ON_AXIS = "feed-"
"""How the names of shared problems with a feed axis begin; they are left out, since the baseline knows no such axis."""
GENERATOR = 1
"""Counts changes of the random scenes: runs on other scenes are other runs."""
DEFAULT_COUNT = 20
"""Random problems of a suite when no number is asked for."""

SUITES: Mapping[str, Callable[[int], Scene]] = {
    "open-space": open_space,
    "clutter-20": partial(clutter, count=20),
    "clutter-40": partial(clutter, count=40),
    "clutter-80": partial(clutter, count=80),
    "duct": corridor,
}
"""Scene from a seed, by the name of its suite; ``clutter-N`` stands for any number of polygons."""
_CLUTTER = re.compile(r"clutter-(\d{1,4})")


@dataclass(frozen=True)
class Case:
    """One problem of a comparison; a random one is made where it is solved.

    Attributes:
        name: of the problem, unique within a comparison.
        suite: where the problem is from; "files" for a file.
        seed: of the random scene.
        given: the problem of a file.
        fingerprint: differs where problems of the same name differ.
    """

    name: str
    suite: str
    seed: int = 0
    given: AnyProblem | None = field(default=None, compare=False)
    fingerprint: str = field(default="")

    def problem(self) -> AnyProblem:
        """The problem itself."""
        if self.given is not None:
            return self.given
        if self.suite.startswith(SPACE):
            return space_maker(self.suite, shared_folder() / "space")(self.seed, self.name)
        scene = scene_maker(self.suite)(self.seed)
        return scene.problem(name=self.name)


def scene_maker(suite: str) -> Callable[[int], Scene]:
    """What makes the scenes of a random suite from seeds.

    Raises:
        ProblemError: when there is no such suite.
    """
    if suite in SUITES:
        return SUITES[suite]
    if found := _CLUTTER.fullmatch(suite):
        return partial(clutter, count=int(found[1]))
    names = ", ".join((SHARED, *SUITES, *SPACE_SUITES))
    raise ProblemError(f"there is no suite '{suite}'; expected one of {names}, or clutter-N with a number of polygons")


def cases_of_suite(suite: str, count: int | None = None, first_seed: int = 0) -> tuple[Case, ...]:
    """The problems of a suite.

    Args:
        suite: its name.
        count: how many; None for all shared problems, or ``DEFAULT_COUNT`` random ones.
        first_seed: of the random problems; the others follow.

    Raises:
        ProblemError: when there is no such suite, or it has fewer problems.
    """
    if suite == SHARED:
        files = sorted(shared_folder().glob("*.toml"))
        cases = cases_of_files([file for file in files if not file.name.startswith(ON_AXIS)])
        if count is not None and count > len(cases):
            raise ProblemError(f"the suite '{SHARED}' has {len(cases)} problems, but --count asks for {count}")
        return cases[:count]
    if suite.startswith(SPACE):
        space_maker(suite, shared_folder() / "space")
    else:
        scene_maker(suite)
    # No scene is made yet: workers make their own from the seed, so that only the seed travels.
    wanted = DEFAULT_COUNT if count is None else count
    seeds = range(first_seed, first_seed + wanted)
    return tuple(
        Case(name=f"{suite}-{seed}", suite=suite, seed=seed, fingerprint=f"{GENERATOR}:{suite}:{seed}")
        for seed in seeds
    )


def cases_of_files(files: Sequence[Path], *, allow_outside: bool = False) -> tuple[Case, ...]:
    """The problems of problem files.

    Args:
        files: the files.
        allow_outside: whether drawings may lie outside the folders of the files.

    Raises:
        ProblemError: when a file cannot be used.
    """
    cases = []
    for file in files:
        problem = load_problem(file, allow_outside=allow_outside)
        fingerprint = _content_hash(problem)
        cases.append(Case(name=problem.name, suite="files", given=problem, fingerprint=fingerprint))
    return tuple(cases)


def _content_hash(problem: AnyProblem) -> str:
    """By content, meshes included: a file of the same name that was edited is another problem."""
    parts = [problem.source]
    if isinstance(problem, SpaceProblem):
        parts += [each.body.digest for each in problem.workspace.obstacles if isinstance(each.body, MeshBody)]
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def distinct(cases: Sequence[Case]) -> tuple[Case, ...]:
    """The cases, each once.

    Raises:
        ProblemError: when two different problems have the same name.
    """
    kept: dict[str, Case] = {}
    for case in cases:
        # A problem given twice is fine; two problems under one name could not be told apart in tables.
        same_name = kept.setdefault(case.name, case)
        if same_name.fingerprint != case.fingerprint:
            raise ProblemError(f"two different problems are called '{case.name}'; give each its own name")
    return tuple(kept.values())


def shared_folder() -> Path:
    """Where the shared problem files are: in the installed package, or beside it in its source tree."""
    installed = Path(__file__).with_name("problems")
    return installed if installed.is_dir() else Path(__file__).parents[2] / "problems"
