"""Where any serial arm is, and which joint angles bring it somewhere."""
