"""How parts meet: contacts, overlaps, fasteners, and the directions that these suggest."""
