"""Data of the player in pages: bodies, their motions, skills and contacts.

The document ``skillplan.playback/1``; lengths in m, angles in rad, z up, quaternions x, y, z, w.
"""
