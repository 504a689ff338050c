"""Problem files: TOML text in, a frozen ``Problem`` out (``reading``), and back; all defects are reported together."""

from ccm_opt.files.problem_file.problem_parts import make_problem
from ccm_opt.files.problem_file.reading import load_problem, parse_problem, problem_from_mapping

__all__ = ["load_problem", "make_problem", "parse_problem", "problem_from_mapping"]
