"""Parts of `studies.double_pendulum`."""
