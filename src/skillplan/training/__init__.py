"""Training of learners: runs kept in a folder, and taken up again bit for bit."""
