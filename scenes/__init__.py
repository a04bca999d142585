"""Scenes: one short file each, whose `build` returns a Scene and whose parameters become flags."""
