"""Elements that push bodies by themselves: springs, liners, loads."""
