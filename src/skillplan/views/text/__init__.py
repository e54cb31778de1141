"""Tables as text: column widths, line breaks, numbers in words; never which table a record has."""
