"""Where and how long work runs."""
