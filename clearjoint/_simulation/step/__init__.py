"""Steps of a run: trial steps, their acceptance, their adjustment so that they end at events, and
their derivatives with respect to parameters."""
