"""Which part blocks which in which direction: rays decide, shrunk meshes confirm."""
