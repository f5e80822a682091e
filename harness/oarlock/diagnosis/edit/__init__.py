"""Copies of an MJCF file with a keyframe or settings changed."""
