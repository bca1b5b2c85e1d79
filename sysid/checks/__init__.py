"""What logs are good for, before anything is fitted: quality, and what they can identify."""
