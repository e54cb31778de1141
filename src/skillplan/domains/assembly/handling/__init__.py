"""How parts are held and brought into place: grasps from any side, directions of insertion."""
