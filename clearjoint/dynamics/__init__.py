"""Equations of motion at one instant: coordinates, constraints, contact forces, energies,
assembly. Nothing here knows steps or solvers of differential equations."""
