"""The paper, claim by claim: trainings, flights, claims with their verdicts, figures, a report."""
