"""Numbers and answers as all tables write them."""

from __future__ import annotations


def percent(fraction: float | None) -> str:
    """Return a fraction in per cent with two decimals, or a dash."""
    return "-" if fraction is None else f"{100 * fraction:.2f} %"


def number(value: float | None, decimals: int) -> str:
    """Return a number, or a dash."""
    return "-" if value is None else f"{value:.{decimals}f}"


def yes_no(value: bool) -> str:
    """Return a truth value as a word."""
    return "yes" if value else "no"


def count(amount: int, noun: str) -> str:
    """Return an amount with its noun, which takes an s in the plural."""
    return f"{amount:,} {noun}" if amount == 1 else f"{amount:,} {noun}s"
