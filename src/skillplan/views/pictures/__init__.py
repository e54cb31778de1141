"""Pictures as lists of shapes, drawn by matplotlib for files and as SVG elements for pages."""
