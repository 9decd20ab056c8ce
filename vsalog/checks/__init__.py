"""What is suspicious about a joint's signals, or about a fit."""
