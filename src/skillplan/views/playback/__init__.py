"""What a page's player shows: bodies, where they are at every moment, and what goes on.

The document ``skillplan.playback/1``; lengths in m, angles in rad, z up, quaternions x, y, z, w.
"""
