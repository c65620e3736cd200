"""A network that stands still, judged: stations, masts, and people who may count as several."""
