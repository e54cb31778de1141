"""Write the files of a task from a plan: meshes, table layout, `product.yaml`."""
