"""Integration in time: steps, complete runs, runs of sweeps side by side (lanes), reductions
(results such as a peak, updated at every step) and the classes of results.

Terms of these modules:

- Rates are time derivatives of the integrated variables. Tangents are derivatives of the variables
  with respect to p parameters; each leaf has an additional first axis of length p.
- An event is the onset or the end of a contact, or a breakpoint: a declared time at which a driver
  or load changes abruptly. Steps end at events.
- The entry speed of a contact, m/s, is its penetration rate at the onset, zero in flight. Bristles
  are the deflections, m, of the surfaces in friction laws that can stick. The energy ledger
  consists of integrals of dissipated and supplied powers, J.
- Dense output is the solver's interpolant inside a step. An attempt is a trial step, accepted or
  rejected, with its data for dense output.
- Times inside a run count from the `origin`, s, of its `System`, a time of the scene; without an
  origin they are times of the scene.
- In a packed scene or state, each vector is an array (3,); in scalar form it is three separate
  scalars. In a folded scene, vector components that are exactly 0 or 1 are marked and become
  constants of the compiled program.
- A lane is one run of a sweep. Compiled code computes many lanes side by side, so that a single one
  of them cannot branch. The host is the process that runs Python.
"""
