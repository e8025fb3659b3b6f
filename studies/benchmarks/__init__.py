"""What the benchmark measures, one module a comparison."""
