"""Model of a mechanism: bodies, joints, laws, the scene, and mechanisms from the literature.

Each element defines its own behaviour; equations of motion and integration are in other packages.
"""
