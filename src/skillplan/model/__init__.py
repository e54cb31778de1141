"""The lazy skill-transition model: the only floor that asks back ends."""
