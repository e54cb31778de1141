"""A solver plugin to copy, which uses only public names of skillplan."""
