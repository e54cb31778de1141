"""Placement of heads that support the sheet, without the bases."""
