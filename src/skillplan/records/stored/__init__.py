"""Results and policies in files, read again. They are never trusted for being there."""
