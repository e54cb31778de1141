"""A report as one page of HTML that needs nothing else; what others named is text in it."""
