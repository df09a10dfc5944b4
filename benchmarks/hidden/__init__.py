"""What `benchmarks.hidden_effects` is made of: rigs, cases, one case's run, scores, the table."""
