"""Problems and plans of either kind, in the plane or in space, for whoever hands them on."""

from typing import TypeAlias

from ccm_opt.solution import Solution
from ccm_opt.space.problem import AnyProblem
from ccm_opt.space.space_solution import SpaceSolution

__all__ = ["AnyProblem", "AnySolution"]

AnySolution: TypeAlias = Solution | SpaceSolution
