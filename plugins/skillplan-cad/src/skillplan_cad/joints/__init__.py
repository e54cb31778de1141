"""Find contacts, overlaps and fasteners, and the directions that they suggest."""
