"""Results and how they are shown: tables, JSON, CSV, Markdown."""
