"""What comes from outside, as arrays and numbers: taken if it can be, else refused by name."""
