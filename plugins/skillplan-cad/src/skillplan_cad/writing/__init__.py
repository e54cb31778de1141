"""From a plan of a product to the files of a task: meshes, a layout, `product.yaml`."""
