"""Obstacles from files: drawings of any kind (``formats``, ``drawing``), and meshes (``mesh_file``)."""
