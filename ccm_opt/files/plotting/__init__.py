"""Pictures of plans; the only part of the package that loads matplotlib."""
