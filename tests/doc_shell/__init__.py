"""A shell in which ``ccm-opt`` and ``python`` begin with the package loaded, for pages of commands."""
