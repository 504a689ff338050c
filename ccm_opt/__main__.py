"""Run the command line as ``python -m ccm_opt``."""

from ccm_opt.cli import main

main()
