"""Equations of motion at one instant: coordinates, constraints, contact forces, energies, assembly.

Values of bodies, joints and elements are dictionaries by name. Values of contacts and of rows
(scalar constraint equations) are by name of joint and label, ``values[joint][label]``; in the code,
`family` is the inner dictionary of one joint. Time steps and solvers of differential equations are
in `clearjoint._simulation`.
"""
