"""The configuration problem as a nonlinear program in CasADi: multiple shooting of the curve through a corridor."""
