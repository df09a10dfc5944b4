"""What `benchmarks.planted` is made of: best models, kinds of errors, cases, scores, the table."""
