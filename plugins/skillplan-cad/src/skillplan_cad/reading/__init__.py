"""Read a product: one module per format, and the repair of meshes."""
