"""THE machine model: stages, effects, landing, the papers' lag models."""
