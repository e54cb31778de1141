"""The lazy skill-transition model: the only floor that queries back ends."""
