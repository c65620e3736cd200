"""How good and how sure a plan is, and what it takes to keep it in the air."""
