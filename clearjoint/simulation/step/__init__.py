"""One step of a run: trial, acceptance, landing on events, and derivatives by parameters."""
