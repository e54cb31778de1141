"""Where heads support the sheet; never where bases stand."""
