"""The nine schemas of the paper, SCM-0 to SCM-8, one function each (section 4.2)."""

from ccm_opt.hill_climbing.schemas.climbing import scm_0, scm_7
from ccm_opt.hill_climbing.schemas.feeding import scm_3, scm_5
from ccm_opt.hill_climbing.schemas.interface import scm_6
from ccm_opt.hill_climbing.schemas.interpolation import scm_2, scm_8
from ccm_opt.hill_climbing.schemas.selection import Selection, scm_1, scm_4

__all__ = ["Selection", "scm_0", "scm_1", "scm_2", "scm_3", "scm_4", "scm_5", "scm_6", "scm_7", "scm_8"]
