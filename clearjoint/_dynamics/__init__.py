"""Equations of motion at one instant: coordinates, constraints, contact forces, energies, assembly.

Time steps and solvers of differential equations are in `clearjoint._simulation`.
"""
