"""Run the command line as ``python -m ccm_opt.cli``."""

from ccm_opt.cli import main

main()
