"""Linear relaxations with cuts, and branch and cut; it never builds an order heuristically."""
