"""Results and policies in files, which are read as untrusted data."""
