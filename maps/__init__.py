"""The world that does not move: poses and angles, wire map, floor, visibility."""
