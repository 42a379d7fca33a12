"""Cameras: from pixels to normalised image coordinates and back."""
