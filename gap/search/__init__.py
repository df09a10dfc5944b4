"""The search for what is missing: candidates, fits, evidence, names."""
