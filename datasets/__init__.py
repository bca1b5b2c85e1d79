"""Data that the project keeps, and what generates it."""
