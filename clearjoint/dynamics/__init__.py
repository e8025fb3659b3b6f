"""Equations of motion at one instant: coordinates, constraints, contact forces, energies, assembly.

Steps and solvers of differential equations are in `clearjoint.simulation`."""
