"""From a file or a folder to a product: one file a format, and what every mesh goes through."""
