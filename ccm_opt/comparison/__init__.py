"""Comparison of planners: several methods on the same problems, in processes of this machine or on a Dask cluster."""
