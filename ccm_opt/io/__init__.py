"""File formats: reading of problem files, drawings and meshes, and writing and reading of output folders."""
