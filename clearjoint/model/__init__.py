"""What a user builds a mechanism of: bodies, joints, laws, the scene, and ready mechanisms. Here
is what each element says of itself; nothing here solves equations of motion or takes a step."""
