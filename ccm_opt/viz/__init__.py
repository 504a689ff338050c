"""The page ``report.html``: one self-contained file for a plan, to be opened in any browser."""
