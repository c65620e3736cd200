"""Learning a local policy by imitation of a rule that knows more (docs/flying.md)."""
