"""Guaranteed bounds: intervals, boxes and the contractors that shrink them."""
