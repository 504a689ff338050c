"""Rigid-body algorithms of Featherstone and Craig as CasADi functions, one file per algorithm."""
