"""Model of a mechanism: bodies, joints, laws, the scene, and mechanisms from the literature.

Each element, such as a joint, defines its own constraints or forces. The equations of motion and
their integration are in other packages.
"""
