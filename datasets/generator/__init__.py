"""Generator of whole campaigns: random rigs, every kind of test, known truth (`README.md`)."""
