"""What most users call."""
