"""What is found out about lamps before triangles are numbered."""
