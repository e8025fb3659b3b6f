"""How far each number of a scene can be driven."""
