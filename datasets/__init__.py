"""The project's data, and the programs that generate them."""
