"""Where any serial arm is, which joint angles bring it somewhere, and paths of its joints."""
