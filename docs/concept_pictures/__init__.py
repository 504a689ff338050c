"""The pictures of the concept pages."""
