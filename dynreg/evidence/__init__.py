"""Evidence: what a recording says for and against a simulator; hypotheses, residuals, fits and intervals."""
