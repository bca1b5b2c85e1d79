"""Two worked components of one's own, and the program that makes logs for them."""
