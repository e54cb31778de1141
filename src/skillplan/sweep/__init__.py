"""Parameter studies: a solver under many settings, each with several seeds, from several starts."""
