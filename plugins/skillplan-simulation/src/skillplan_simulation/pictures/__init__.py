"""Pictures of simulated cells, the same whichever engine simulates them.

A cell is drawn from where its bodies and joints are, so that no engine has to draw; captions, name
tags and arrows are written onto any picture.
"""
