"""Tests of ccm_opt; each test states its contract in its docstring."""
