"""Registration of two raw clouds."""
