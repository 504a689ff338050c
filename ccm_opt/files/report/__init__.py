"""``report.html``: one self-contained page of a plan, to be opened in any browser."""
