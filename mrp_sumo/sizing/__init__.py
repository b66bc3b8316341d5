"""How many robots fit: studies that choose their own runs, and what they find."""
