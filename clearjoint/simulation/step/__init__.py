"""One step: trial, acceptance, landing on events, and derivatives beside the state."""
