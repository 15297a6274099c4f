"""Metamodels of variable slipper gaps, each with the numbers that it was fitted to; files here are ``<hash>.json``."""

from twin.slipper_maps.stored import StoredMap, document_of, gap_numbers_hash, is_inside, map_from, register, stored_map

__all__ = ["StoredMap", "document_of", "gap_numbers_hash", "is_inside", "map_from", "register", "stored_map"]
