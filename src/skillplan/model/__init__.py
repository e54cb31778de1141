"""The lazy skill-transition model; it never queries a back end itself, `checks` does."""
