"""Local search on orders; it never claims a bound."""
