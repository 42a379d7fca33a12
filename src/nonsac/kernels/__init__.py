"""Compiled numerical kernels: arrays in, arrays and counts out; they never raise, print or take functions."""
