"""Test parts for blocking along directions, by rays; shrunk meshes confirm the answers."""
