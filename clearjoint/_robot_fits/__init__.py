"""Play, friction and inertia of a robot's joints from its log."""
